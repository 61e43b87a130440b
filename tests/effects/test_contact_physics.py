"""Effects of contact reach the physics as closed forms say: on the cell itself, its arm clamped or driven."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from clamped import BESIDE, SCENE, SLIP, TOP, G, bench, contact_force, pose, written
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from vispeg.core.effect import EffectInstance
from vispeg.effects.contact.restitution import ratio, rebound
from vispeg.worlds.world import World

MASS = SCENE.compile().body("peg").mass[0]
FRICTION = SCENE.config.friction
NOMINAL = World()


def one(name: str, where: str = "peg", **values: float) -> World:
    return World().add(EffectInstance.of(name, where, **values))


def drop(worlds, height: float, seconds: float):
    """Speed (n, nsim) of the peg let go `height` m above the fixture, its way (nsim,) past touching, and the batch."""
    batch = bench(worlds, (*BESIDE, TOP + height), 1e-4)
    qpos, qvel, speed = batch.bind("qpos"), batch.bind("qvel"), []
    for _ in range(round(seconds / 1e-4)):
        batch.step()
        speed.append(qvel[:, SLIP].copy())
    return np.array(speed), qpos[:, SLIP] - height, batch


def test_friction_is_coulombs_with_the_scaled_coefficient():
    """The peg drawn over the fixture's top, pressed down: |f_t| / f_n; of the two surfaces the peg's is heard."""
    scales = (1.0, 1.5, 0.5, 1.0)
    worlds = [
        NOMINAL,
        *(one("contact_friction", scale=s) for s in scales[1:3]),
        one("contact_friction", "fixture", scale=3.0),
    ]
    batch = bench(worlds, (*BESIDE, TOP + 1e-5), 2e-4)
    batch.bind("qvel")[:, 0] = 0.1 / BESIDE[0]  # about the base's axis: a level path
    batch.bind("qfrc_applied")[:, SLIP] = 20.0
    force = []
    for k in range(400):
        batch.step()
        if k >= 300 and k % 5 == 0:
            force.append([contact_force(batch, row) for row in range(4)])
    force = np.array(force)
    mu = np.hypot(force[..., 0], force[..., 1]).mean(axis=0) / force[..., 2].mean(axis=0)
    np.testing.assert_allclose(mu, FRICTION * np.array(scales), rtol=1e-3)
    assert (force[..., 1].mean(axis=0) < 0).all(), "friction opposes the motion"


def test_bounce_damping_and_rest_depth():
    """Speed that comes back, and depth at rest ~ 1 / stiffness, whatever the damping."""
    worlds = [
        NOMINAL,
        one("restitution", e=0.5),
        one("restitution", e=0.8),
        one("contact_damping", scale=0.3),
        one("contact_damping", scale=2.0),
        one("contact_stiffness", scale=0.25),
        one("restitution", e=0.05),  # less than nominal damping lets through: nothing to do
    ]
    speed, _, batch = drop(worlds, 0.0102, 0.2)
    hit = speed.argmax(axis=0)
    np.testing.assert_allclose(speed[hit, range(len(worlds))], np.sqrt(2 * G * 0.0102), rtol=5e-3)
    back = np.array([-speed[k : k + 600, row].min() / speed[k, row] for row, k in enumerate(hit)])
    expected = np.array([rebound(1.0), 0.5, 0.8, rebound(0.3), rebound(2.0), rebound(1.0), rebound(1.0)])
    same = np.arange(len(worlds)) != 5
    np.testing.assert_allclose(back[same], expected[same], atol=8e-3)
    assert back[5] == pytest.approx(expected[5], rel=0.12), "a softer contact throws back nearly as much"
    data = [batch.get_data(row) for row in (0, 4, 5)]
    for row, d in zip((0, 4, 5), data, strict=True):
        mujoco.mj_forward(batch.get_model(row), d)
    assert len({d.ncon for d in data}) == 1, "points of contact share the weight"
    nominal, damped, soft = (np.mean(d.contact.dist) for d in data)
    assert soft / nominal == pytest.approx(4.0, rel=0.03)
    assert damped / nominal == pytest.approx(1.0, rel=0.03)
    np.testing.assert_array_equal(speed[:, 6], speed[:, 0])


@pytest.mark.parametrize(("load", "within"), [(2.0, 0.05), (12.0, 0.05), (60.0, 0.03)])
def test_a_softer_contact_stands_deeper_under_any_load(load, within):
    """1 / stiffness times; 60 N on four contacts leave the part of MuJoCo's curve where the law is exact."""
    worlds = [NOMINAL, one("contact_stiffness", scale=0.1), one("contact_stiffness", scale=0.02)]
    batch = bench(worlds, (*BESIDE, TOP), 5e-4)
    down = batch.bind("qfrc_applied")
    down[:, SLIP] = load
    for _ in range(1200):
        batch.step()
    depth = []
    for row in range(len(worlds)):
        d = batch.get_data(row)
        mujoco.mj_forward(batch.get_model(row), d)
        depth.append(d.contact.dist.mean())
    np.testing.assert_allclose(np.array(depth) / depth[0], [1.0, 10.0, 50.0], rtol=within)


@pytest.mark.parametrize("z", [0.1, 0.3, 0.8, 1.7])
def test_rebound_is_that_of_a_dashpot_that_cannot_pull(z):
    """Schwager and Poeschel's form against the integrated equation x'' = -2 z x' - x, ended where the force is zero."""

    def force(t, s):
        return -2 * z * s[1] - s[0]

    force.terminal, force.direction = True, 0
    out = solve_ivp(lambda t, s: [s[1], force(t, s)], (0, 50), [1e-12, 1.0], events=force, rtol=1e-10, atol=1e-12)
    assert out.y_events is not None
    assert rebound(z) == pytest.approx(-out.y_events[0][0][1], rel=1e-5)
    assert ratio(rebound(z)) == pytest.approx(z, rel=1e-5)


def test_object_mass_is_the_weight_on_the_fixture_and_gravity_scales_it():
    worlds = [NOMINAL, one("object_mass", scale=1.3), one("gravity_scale", "scene", scale=0.5)]
    batch = bench(worlds, (*BESIDE, TOP + 1e-5), 1e-4)
    for _ in range(1000):
        batch.step()
    weight = [contact_force(batch, row)[2] for row in range(3)]
    np.testing.assert_allclose(weight, MASS * G * np.array([1.0, 1.3, 0.5]), rtol=5e-3)


def test_gravity_scale_is_felt_in_free_fall():
    speed, _, _ = drop([NOMINAL, one("gravity_scale", "scene", scale=1.1)], 0.02, 0.03)
    np.testing.assert_allclose(speed[-1], [G * 0.03, 1.1 * G * 0.03], rtol=1e-4)


def test_the_peg_slips_at_the_scaled_grip():
    """The gripper driven down over a peg that stands: fixture's force less weight = grip, by Coulomb."""
    worlds = [one("gripper_slip", grip=g) for g in (1.0, 0.1, 0.3)]
    batch = bench(worlds, (*BESIDE, TOP + 1e-5), 2e-4, velocity=(0, 0, -0.005), loose=False)
    for _ in range(600):
        batch.step()
    grip = np.array([contact_force(batch, row)[2] - MASS * G for row in range(3)])
    np.testing.assert_allclose(grip, 120.0 * np.array([1.0, 0.1, 0.3]), rtol=5e-3)
    assert (batch.bind("qpos")[:, SLIP] < -4e-4).all(), "it slipped"


def test_what_slips_in_soft_fingers_is_held_more_the_faster_it_goes():
    """The same, driven at 5 and 10 mm/s: grip and viscosity times speed."""
    viscosity = np.array([0.0, 1000.0, 4000.0])
    for speed in (0.005, 0.01):
        worlds = [one("gripper_slip", grip=0.2, viscosity=v) for v in viscosity]
        batch = bench(worlds, (*BESIDE, TOP + 1e-5), 2e-4, velocity=(0, 0, -speed), loose=False)
        for _ in range(600):
            batch.step()
        held = np.array([contact_force(batch, row)[2] - MASS * G for row in range(3)])
        np.testing.assert_allclose(held, 120.0 * 0.2 + viscosity * speed, rtol=1e-2)


def test_the_hole_is_as_wide_as_its_effect_says():
    """The peg moved sideways in the hole meets the wall after half the clearance, wider and narrower, on both sides."""
    widths = np.array([0.0, 0.002, -0.001, -0.0028])
    expected = SCENE.config.clearance_mm / 2000 + widths / 2
    for side in (1, -1):
        worlds = [one("hole_clearance", "fixture", width=w) for w in widths]
        batch = bench(worlds, (0.6, 0.0, TOP - 0.015), 5e-4, velocity=(0.02 * side, 0, 0), loose=False)
        tip, ncon = batch.bind("site_xpos"), batch.bind("ncon")
        site, met = batch.model.site("peg_tip").id, np.full(len(widths), np.nan)
        for _ in range(280):
            batch.step()
            touched = np.isnan(met) & (ncon.ravel() > 0)
            met[touched] = side * (tip[touched, site, 0] - 0.6)
        np.testing.assert_allclose(met, expected, atol=1.5e-5)


def test_the_hole_moves_and_turns_with_the_fixture():
    world = one("hole_offset", "fixture", x=0.02, y=-0.01, z=0.003)
    world = world.add(EffectInstance.of("hole_tilt", "fixture", roll=0.1, pitch=-0.2, yaw=0.3))
    batch, _ = written([NOMINAL, world])
    pos, rot, site = batch.bind("site_xpos"), batch.bind("site_xmat"), batch.model.site("hole").id
    batch.forward()
    place, mat = pos[:, site], rot[:, site].reshape(2, 3, 3)
    np.testing.assert_allclose(place[1] - place[0], [0.02, -0.01, 0.003], atol=1e-15)
    cr, sr, cp, sp, cy, sy = (f(a) for a in (0.1, -0.2, 0.3) for f in (np.cos, np.sin))
    rx, ry, rz = (
        np.array(m)
        for m in (
            [[1, 0, 0], [0, cr, -sr], [0, sr, cr]],
            [[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]],
            [[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]],
        )
    )
    np.testing.assert_allclose(mat[1], rz @ ry @ rx @ mat[0], atol=1e-12)


def test_the_moved_fixture_is_where_the_peg_lands():
    worlds = [NOMINAL, one("hole_offset", "fixture", z=-0.004), one("hole_offset", "fixture", x=0.1)]
    _, depth, _ = drop(worlds, 0.002, 0.08)
    assert depth[1] - depth[0] == pytest.approx(0.004, abs=2e-6)
    assert depth[2] > 0.02, "nothing stands there any more"


def test_grip_pose_turns_the_peg_about_its_centre():
    values = {"x": 0.001, "y": -0.002, "z": 0.0005, "roll": 0.05, "pitch": -0.03}
    batch, _ = written([NOMINAL, one("grip_pose", **values)])
    batch.bind("qpos")[:, :7] = pose(*BESIDE, TOP)
    pos, rot, model = batch.bind("site_xpos"), batch.bind("site_xmat"), batch.model
    batch.forward()
    site, flange = model.site("peg_tip").id, model.site("flange").id
    mat = rot[:, flange].reshape(2, 3, 3)
    tip = np.einsum("nji,nj->ni", mat, pos[:, site] - pos[:, flange])
    centre = model.body("peg").ipos
    turn = Rotation.from_euler("y", -0.03).as_matrix() @ Rotation.from_euler("x", 0.05).as_matrix()
    shift = np.array([values[a] for a in "xyz"])
    np.testing.assert_allclose(tip[1], centre + turn @ (tip[0] - centre) + shift, atol=1e-12)


def test_a_solver_stopped_early_takes_no_more_steps_and_leaks():
    """A jammed peg needs a dozen Newton steps; a cap holds, changes the force, and a higher one changes nothing."""
    scales = (0.01, 0.03, 2.0)
    batch, _ = written([NOMINAL, *(one("solver_iterations", "scene", scale=s) for s in scales)])
    batch.expand("opt.timestep")[:] = 1e-3
    batch.bind("qpos")[:, :7] = pose(0.6012, 0, TOP - 0.015)
    count, most = batch.bind("solver_niter"), np.zeros(4, int)
    for _ in range(100):
        batch.step()
        most = np.maximum(most, count.reshape(4, -1).max(axis=1))
    assert most[0] > 3 and most.tolist() == [most[0], 1, 3, most[0]]
    state = batch.bind("qpos")
    np.testing.assert_array_equal(state[3], state[0])
    assert np.abs(state[1] - state[0]).max() > 1e-6 and np.abs(state[2] - state[0]).max() > 1e-6


def test_believed_goal_is_off_by_the_imprecision_and_the_goal_is_not():
    from vispeg.sim.placement import activate

    world = one("goal_imprecision", "hole", x=0.002, y=-0.001)
    (active,) = activate(SCENE, [NOMINAL, world])
    goal = np.array([[0.6, 0.0, 0.05], [0.61, 0.01, 0.05]])
    told = active.effect.believe(goal, active.p)
    np.testing.assert_array_equal(told[0], goal[0])
    np.testing.assert_allclose(told[1] - goal[1], [0.002, -0.001, 0.0], atol=1e-15)
    batch, fields = written([world])
    assert not fields.touched and isinstance(batch.model, mujoco.MjModel)


def test_the_peak_of_a_blow_hardly_goes_by_the_stiffness():
    """Docs: 5 % more at a quarter of the stiffness, 15 % at a tenth, from any height: damping stops a blow."""
    worlds = [NOMINAL, one("contact_stiffness", scale=0.25), one("contact_stiffness", scale=0.1)]
    for height in (0.005, 0.02):
        speed, _, _ = drop(worlds, height, np.sqrt(2 * height / G) + 0.012)
        peak = (-np.diff(speed, axis=0) / 1e-4).max(axis=0)
        np.testing.assert_allclose(peak / peak[0], [1.0, 1.05, 1.15], atol=0.01)


def test_a_ball_stands_as_deep_as_the_formulas_of_the_guide_say():
    """docs/worlds.md: stiffness m d k / (1 - d) of what the contact moves, against MuJoCo alone."""
    contact = 'solref="0.004 1" solimp="0.95 0.99 0.0002 0.5 2"'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="0.0005"/><worldbody><geom type="plane" size="1 1 .1" {contact}/>'
        f'<body pos="0 0 0.1"><freejoint/><geom size="0.1" mass="0.83" {contact}/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.xfrc_applied[1, 2] = 0.83 * G - 18.0
    for _ in range(2000):
        mujoco.mj_step(model, data)
    depth = -float(data.contact.dist[0])
    assert depth == pytest.approx(18.7e-6, rel=0.02) and 18 / depth == pytest.approx(9.7e5, rel=0.02)
    d, d1, t, z, m = 0.95, 0.99, 0.004, 1.0, 0.83
    assert m * d * (d / (d1 * t * z) ** 2) / (1 - d) == pytest.approx(9.6e5, rel=0.01)
    assert m * d * (2 / (d1 * t)) / (1 - d) == pytest.approx(8.0e3, rel=0.01)
