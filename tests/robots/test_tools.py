"""A tool adds exactly its own inertia at the flange."""

import mujoco
import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.robots.declared import carried
from vispeg.robots.model import load

TOOL = {"mass_kg": 2.0, "com_m": [0.03, -0.02, 0.08], "inertia_kgm2": [0.004, 0.005, 0.006], "name": "camera rig"}
Q = np.array([0.3, 0.7, -0.4, -1.1, 0.6, 0.9, -0.2])


def inertia(robot):
    """Joint-space inertia (7, 7) and bias (7,) at Q, and flange Jacobians."""
    model = robot.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = Q
    mujoco.mj_forward(model, data)
    full = np.zeros((7, 7))
    mujoco.mj_fullM(model, data, full)
    return model, data, full


def test_stated_tool_adds_its_kinetic_and_potential_energy():
    """M grows by m Jv'Jv + Jw' R I R' Jw and gravity torque by -Jv' m g, at the tool's centre of mass."""
    model, data, bare = inertia(load("iiwa14"))
    _, loaded, full = inertia(load("iiwa14", TOOL))
    rot = data.site("flange").xmat.reshape(3, 3)
    com = data.site("flange").xpos + rot @ TOOL["com_m"]
    jv, jw = np.zeros((3, 7)), np.zeros((3, 7))
    mujoco.mj_jac(model, data, jv, jw, com, model.body("link7").id)
    added = 2.0 * jv.T @ jv + jw.T @ rot @ np.diag(TOOL["inertia_kgm2"]) @ rot.T @ jw
    np.testing.assert_allclose(full - bare, added, atol=1e-12)
    np.testing.assert_allclose(loaded.qfrc_bias - data.qfrc_bias, -jv.T @ [0, 0, -2.0 * 9.81], atol=1e-12)
    np.testing.assert_allclose(loaded.site("flange").xpos, data.site("flange").xpos)


def test_point_mass_is_a_tool():
    model = load("iiwa14", {"mass_kg": 1.0, "com_m": [0, 0, 0.1], "inertia_kgm2": [0, 0, 0]}).compile()
    assert model.body("tool").mass[0] == 1.0 and not model.body("tool").inertia.any()


def test_a_tool_without_mass_carries_nothing():
    tool = {"mass_kg": 0.0, "com_m": [0.01, 0.0, 0.1], "inertia_kgm2": [0.0, 0.0, 0.0]}
    found = carried(load("iiwa14", tool).compile())
    assert found == {**tool, "com_m": [0.0, 0.0, 0.0]}


@pytest.mark.parametrize("tool", [None, "none"])
def test_no_tool(tool):
    assert load("iiwa14", tool).compile().nbody == load("iiwa14").compile().nbody


def test_gripper_and_peg_against_volume_integrals():
    """Mass and inertia of gripper and peg equal sums over a grid of small cubes."""
    model = load("iiwa14", "meg50+peg40").compile()
    assert model.body("tool").mass[0] == pytest.approx(0.7)
    assert model.body("peg").mass[0] == pytest.approx(7850 * np.pi * 0.02**2 * 0.08)
    n = 60
    u = (np.arange(n) + 0.5) / n - 0.5
    unit = np.stack(np.meshgrid(u, u, u, indexing="ij"), -1).reshape(-1, 3)
    points, weights = [], []
    for name, mass in {"gripper": 0.62, "finger_left": 0.04, "finger_right": 0.04}.items():
        geom = model.geom(name)
        points.append(geom.pos + unit * 2 * geom.size)
        weights.append(np.full(len(unit), mass / len(unit)))
    points, weights = np.vstack(points), np.hstack(weights)
    com = weights @ points / weights.sum()
    np.testing.assert_allclose(model.body("tool").ipos, com, atol=1e-9)
    r = points - com
    want = np.einsum("n,nij->ij", weights, np.einsum("nk,nk,ij->nij", r, r, np.eye(3)) - r[:, :, None] * r[:, None])
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body("tool").iquat)
    turn = turn.reshape(3, 3)
    np.testing.assert_allclose(turn @ np.diag(model.body("tool").inertia) @ turn.T, want, rtol=1e-3, atol=1e-7)


def test_peg_is_held_between_the_fingers_and_points_outwards():
    model = load("iiwa14", "meg50+peg30").compile()
    peg, left, right = (model.geom(n) for n in ("peg", "finger_left", "finger_right"))
    assert 2 * peg.size[0] == pytest.approx(0.030) and 2 * peg.size[1] == pytest.approx(0.080)
    gap = (left.pos[0] - left.size[0]) - (right.pos[0] + right.size[0])
    assert gap == pytest.approx(2 * peg.size[0])
    assert peg.pos[2] + peg.size[1] == pytest.approx(model.site("peg_tip").pos[2])
    assert model.site("peg_tip").pos[2] > left.pos[2] + left.size[2]  # the tip stands clear of the fingers


def test_peg_touches_the_scene_and_not_the_arm():
    spec = load("iiwa14", "meg50+peg40").spec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=(0.5, 0.5, 0.02), pos=(0, 0, 1.5), name="plate")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    touching = {frozenset(model.geom(int(g)).name for g in c.geom) for c in data.contact}
    assert touching == {frozenset({"plate", "peg"})}


@pytest.mark.parametrize(
    "tool, says",
    [
        ("meg51", "meg50"),
        ("meg50+peg400", "5 to 80 mm"),
        ({"mass_kg": 1.0, "com_m": [0, 0, 0]}, "tool.inertia_kgm2: missing"),
        ({**TOOL, "com_m": [0, 0]}, "tool.com_m"),
        ({**TOOL, "mass_kg": -1.0}, "tool.mass_kg"),
        ({**TOOL, "mass_kg": "heavy"}, "tool.mass_kg"),
        ({**TOOL, "mass_kg": float("nan")}, "tool.mass_kg"),
        ({**TOOL, "inertia_kgm2": [1, 0, 0]}, "tool.inertia_kgm2"),
        ({**TOOL, "mas": 1.0}, "mass_kg"),
        (3.0, "tool"),
    ],
)
def test_bad_tools_are_named_in_one_line(tool, says):
    with pytest.raises(UserError) as error:
        load("iiwa14", tool)
    assert says in str(error.value) and "\n" not in str(error.value)


def test_tool_mapping_is_not_changed_and_equal_tools_share_a_robot():
    tool = {**TOOL, "com_m": list(TOOL["com_m"])}
    assert load("iiwa14", tool) is load("iiwa14", TOOL)
    assert tool == TOOL


TURNED = """<mujoco><worldbody><body name="a"><joint name="j" axis="0 1 0"/><geom size=".1"/>
  <body name="b" pos="0 0 -.5"><joint name="k" axis="1 0 0"/><geom size=".1"/>{}</body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    "site",
    [
        '<site name="flange" pos="0 0 -.4" euler="0 90 0"/>',
        '<site name="flange" pos="0 0 -.4" axisangle="0 1 0 90"/>',
        '<site name="flange" pos="0 0 -.4" xyaxes="0 0 -1 0 1 0"/>',
        '<site name="flange" pos="0 0 -.4" zaxis="1 0 0"/>',
        '<frame pos="0 0 -.4" euler="0 90 0"><site name="flange"/></frame>',
    ],
)
def test_a_tool_turns_with_the_flange_however_its_file_states_the_turn(tmp_path, site):
    """A centre of mass 0.1 m along the flange's z axis, which is the link's x axis."""
    (tmp_path / "arm.xml").write_text(TURNED.format(site))
    tool = {"mass_kg": 1.0, "com_m": [0.0, 0.0, 0.1], "inertia_kgm2": [0.001, 0.002, 0.003]}
    found = []
    for held in (tool, None):
        model = load(tmp_path / "arm.xml", held).compile()
        data = mujoco.MjData(model)
        data.qpos[:] = 0.5, 0.0
        mujoco.mj_forward(model, data)
        found.append(data.qfrc_bias.copy())
    x = 0.1 * np.cos(0.5) - 0.9 * np.sin(0.5)  # m, of the tool's centre of mass from the first joint
    np.testing.assert_allclose(found[0] - found[1], [-9.81 * x, 0.0], atol=1e-9)
