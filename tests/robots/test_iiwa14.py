"""The nominal arm against its own published numbers and against mechanics written out independently here."""

import mujoco
import numpy as np
import pytest

from vispeg.core.assets import assets
from vispeg.robots.model import load

# body, position in the parent, quaternion wxyz before normalisation, mass, centre of mass, inertia, range
TABLE = """
base  0 0 0       1 0 0 0  5     -0.1 0 0.07        0.05 0.06 0.03        0
link1 0 0 0.1575  1 0 0 0  5.76  0 -0.03 0.12       0.0333 0.033 0.0123   2.96706
link2 0 0 0.2025  0 0 1 1  6.35  0.0003 0.059 0.042 0.0305 0.0304 0.011   2.0944
link3 0 0.2045 0  0 0 1 1  3.5   0 0.03 0.13        0.025 0.0238 0.0076   2.96706
link4 0 0 0.2155  1 1 0 0  3.5   0 0.067 0.034      0.017 0.0164 0.006    2.0944
link5 0 0.1845 0  0 0 1 1  3.5   0.0001 0.021 0.076 0.01 0.0087 0.00449   2.96706
link6 0 0 0.2155  1 1 0 0  1.8   0 0.0006 0.0004    0.0049 0.0047 0.0036  2.0944
link7 0 0.081 0   0 0 1 1  1.2   0 0 0.02           0.001 0.001 0.001     3.05433
"""
ROWS = [(w[0], np.array(w[1:], float)) for w in (line.split() for line in TABLE.strip().splitlines())]
POSTURES = np.random.default_rng(3).uniform(-1.9, 1.9, (6, 7))


def rotation(q):
    """Rotation matrix of a quaternion by Rodrigues' formula."""
    q = q / np.linalg.norm(q)
    half = np.linalg.norm(q[1:])
    if half == 0.0:
        return np.eye(3)
    k = q[1:] / half
    cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    angle = 2 * np.arctan2(half, q[0])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def frame(rot, pos):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rot, pos
    return out


def frames(q):
    """World poses (8, 4, 4) of base and links."""
    pose, out = np.eye(4), []
    for (_, row), angle in zip(ROWS, [0.0, *q], strict=True):
        turn = rotation(np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2)]))
        pose = pose @ frame(rotation(row[3:7]), row[:3]) @ frame(turn, np.zeros(3))
        out.append(pose)
    return np.array(out)


def potential(q, gravity=(0, 0, -9.81)):
    """Potential energy in J."""
    return -sum(
        row[7] * np.dot(gravity, (pose @ [*row[8:11], 1])[:3]) for (_, row), pose in zip(ROWS, frames(q), strict=True)
    )


def at(model, q):
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    return data


@pytest.fixture(scope="module")
def arm():
    return load("iiwa14")


def test_masses_and_inertias_are_the_table(arm):
    model = arm.compile()
    assert model.nbody == 1 + len(ROWS)
    for name, row in ROWS:
        body = model.body(name)
        assert body.mass[0] == row[7]
        np.testing.assert_array_equal(body.ipos, row[8:11])
        # MuJoCo sorts nothing when the inertia is given as diagonal with identity orientation
        turn = rotation(np.array(body.iquat))
        np.testing.assert_allclose(turn @ np.diag(body.inertia) @ turn.T, np.diag(row[11:14]), atol=1e-15)


def test_limits_are_the_table(arm):
    np.testing.assert_array_equal(arm.range[:, 1], [row[14] for _, row in ROWS[1:]])
    np.testing.assert_array_equal(arm.range[:, 0], -arm.range[:, 1])
    np.testing.assert_array_equal(arm.torque_limit, [320, 320, 176, 176, 110, 40, 40])
    np.testing.assert_allclose(np.rad2deg(arm.velocity_limit), [85, 85, 100, 75, 130, 135, 135], atol=0.01)
    np.testing.assert_array_equal(arm.compile().jnt_range, arm.range)


@pytest.mark.parametrize("q", POSTURES)
def test_flange_is_the_product_of_the_frames(arm, q):
    site = at(arm.compile(), q).site(arm.flange)
    pose = frames(q)[-1] @ frame(np.eye(3), [0, 0, 0.045])
    np.testing.assert_allclose(site.xpos, pose[:3, 3], atol=1e-14)
    np.testing.assert_allclose(site.xmat.reshape(3, 3), pose[:3, :3], atol=1e-14)


@pytest.mark.parametrize("q", POSTURES)
def test_gravity_torque_is_the_slope_of_the_potential(arm, q):
    h, bias = 1e-5, at(arm.compile(), q).qfrc_bias
    slope = [(potential(q + h * e) - potential(q - h * e)) / (2 * h) for e in np.eye(7)]
    np.testing.assert_allclose(bias, slope, atol=2e-8)
    assert np.abs(bias).max() > 1.0


@pytest.mark.parametrize("tilt", [(0.3, 0.0), (0.0, 0.3), (0.2, -0.4)])
def test_tilted_base_turns_gravity_the_stated_way(tilt):
    """A base turned by Rx(roll) Ry(pitch) sees g through the inverse; the torque follows that potential."""
    roll, pitch = tilt
    turn = rotation(np.array([np.cos(roll / 2), np.sin(roll / 2), 0, 0])) @ rotation(
        np.array([np.cos(pitch / 2), 0, np.sin(pitch / 2), 0])
    )
    gravity = turn.T @ [0, 0, -9.81]
    model = load("iiwa14", base_tilt=tilt).compile()
    np.testing.assert_allclose(model.opt.gravity, gravity, atol=1e-14)
    q, h = POSTURES[0], 1e-5
    slope = [(potential(q + h * e, gravity) - potential(q - h * e, gravity)) / (2 * h) for e in np.eye(7)]
    np.testing.assert_allclose(at(model, q).qfrc_bias, slope, atol=2e-8)


def test_pitch_by_hand():
    """Pitched nose down (+y turn), the base's x axis dips, so gravity has a positive x part."""
    assert load("iiwa14", base_tilt=(0.0, 0.1)).compile().opt.gravity[0] == pytest.approx(9.81 * np.sin(0.1))
    assert load("iiwa14", base_tilt=(0.1, 0.0)).compile().opt.gravity[1] == pytest.approx(-9.81 * np.sin(0.1))


def test_nominal_arm_has_no_effects_and_no_self_contact(arm):
    model = arm.compile()
    for name in ("dof_armature", "dof_damping", "dof_frictionloss", "jnt_stiffness"):
        assert not getattr(model, name).any(), name
    assert not model.geom_contype.any()
    assert not model.actuator_ctrllimited.any() and not model.actuator_forcelimited.any()
    assert all(at(model, q).ncon == 0 for q in POSTURES)


def test_motors_push_their_own_joint_one_to_one(arm):
    model = arm.compile()
    data = at(model, POSTURES[0])
    data.ctrl[:] = torque = np.arange(1.0, 8.0) * 1000  # far above any limit
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator, torque)
    assert [model.actuator(i).name for i in range(model.nu)] == list(arm.joints)


def test_free_arm_keeps_its_energy(arm):
    model = arm.compile()
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = 1e-3
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    data = at(model, POSTURES[1])
    start = data.energy.sum()
    for _ in range(400):
        mujoco.mj_step(model, data)
    assert data.energy[1] > 1.0  # it fell
    assert data.energy.sum() == pytest.approx(start, abs=1e-4)


def test_every_spec_is_the_callers_own(arm):
    first, second = arm.spec(), arm.spec()
    first.body("link3").mass = 99.0
    first.joint("joint1").damping = [5.0, 0.0, 0.0]
    first.option.gravity = (0, 0, 0)
    for spec in (second, arm.spec()):
        model = spec.compile()
        assert model.body("link3").mass[0] == 3.5
        assert not model.dof_damping.any() and model.opt.gravity[2] == -9.81


def test_limits_cannot_be_written_to(arm):
    with pytest.raises(ValueError, match="read-only"):
        arm.torque_limit[0] = 1.0


def test_meshes_are_shipped_small_and_weightless(arm):
    model = arm.compile()
    shown = {model.body(int(b)).name for b in model.geom_bodyid}
    assert shown == {name for name, _ in ROWS}
    assert model.mesh_facenum.sum() <= 4000
    assert sum(f.stat().st_size for f in (assets() / "iiwa14").glob("*.stl")) < 300_000
    assert model.body_mass.sum() == pytest.approx(sum(row[7] for _, row in ROWS), abs=1e-12)
