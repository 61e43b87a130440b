"""An exported MJCF moves in plain MuJoCo as the plant does, and says which effects it could not hold."""

from dataclasses import replace

import cv2
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vispeg.api.export.model import export_model
from vispeg.api.inputs import read_model
from vispeg.core.assets import assets
from vispeg.core.effect import EffectInstance, searchable
from vispeg.robots.model import load
from vispeg.sim.compiled import nominal_of
from vispeg.sim.export import MOTOR, STEP, compiled_with, is_native, to_mjcf
from vispeg.sim.plant import Plant
from vispeg.sim.servo import Servos
from vispeg.task.belief import model_cell
from vispeg.task.cell import Cell
from vispeg.task.rig.posture import start_angles
from vispeg.worlds.world import World

ROBOT = load("iiwa14")
Q0 = np.array([0.1, 0.5, -0.2, -1.2, 0.3, 0.9, 0.0])


def written(world, folder):
    made = to_mjcf(world)
    for name, content in made.meshes.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    (folder / "arm.xml").write_text(made.xml)
    return mujoco.MjModel.from_xml_path(str(folder / "arm.xml")), made


def torques(n):
    t = STEP * np.arange(n)[:, None]
    return np.array([4, 12, 4, 8, 2, 1.5, 0.4]) * np.sin(2 * np.pi * (0.7 + 0.2 * np.arange(7)) * t + np.arange(7))


def plain(model, n):
    """Joint angles of MuJoCo alone under the torques, (n, nj)."""
    data = mujoco.MjData(model)
    data.qpos[:] = Q0
    out = []
    for u in torques(n):
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
        out.append(data.qpos.copy())
    return np.array(out)


def ours(world, n):
    """The same of the plant, whose batch is stepped with the torques that the effects make of the commands."""
    plant = Plant(ROBOT, [world], STEP, STEP, 1)
    plant.start(Q0[None], np.zeros((1, 7)), np.zeros((1, 7)), np.ones((1, 7)))
    out = []
    for u in torques(n):
        plant.read()
        plant.ctrl[:, plant.u] = plant.forces(u[None]).drive
        plant.batch.step()
        out.append(plant.qpos[0, plant.qadr].copy())
    return np.array(out)


def big(name):
    kind = searchable()[name]
    where = kind.targets(ROBOT)[min(3, len(kind.targets(ROBOT)) - 1)]
    sizes = {k: p.start for k, p in kind.params.items()} | ({"limit": 3.0} if name == "torque_limit" else {})
    return EffectInstance.of(name, where, **sizes)


NATIVE = sorted(n for n, e in searchable().items() if is_native(e))


def test_what_is_native():
    assert {"coulomb_friction", "viscous_friction", "payload", "link_mass", "rotor_inertia", *MOTOR} <= set(NATIVE)
    assert not {"stribeck_friction", "backlash", "encoder_offset", "actuator_lag"} & set(NATIVE)


@pytest.mark.parametrize("name", [n for n in NATIVE if n != "servo"])
def test_plain_mujoco_moves_as_the_plant_does(name, tmp_path):
    world = World("iiwa14").add(big(name))
    model, made = written(world, tmp_path)
    assert made.native == world.effects and made.left_out == ()
    found, expected = plain(model, 300), ours(world, 300)
    moved = np.abs(expected - plain(written(World("iiwa14"), tmp_path)[0], 300)).max()
    assert moved > 1e-5, "the effect changes the motion"
    assert np.abs(found - expected).max() < 1e-3 * moved + 1e-9


def test_gain_bias_and_limit_of_one_motor_follow_the_drive_chain(tmp_path):
    effects = [
        EffectInstance.of("torque_gain", "joint4", gain=1.4),
        EffectInstance.of("joint_bias", "joint4", torque=2),
    ]
    world = World("iiwa14").add(*effects, EffectInstance.of("torque_limit", "joint4", limit=5.0))
    model, _ = written(world, tmp_path)
    assert np.allclose(plain(model, 300), ours(world, 300), atol=1e-9)


def followed(model, goals):
    """Joint angles (n, nj) of MuJoCo alone, whose actuators take goals."""
    data = mujoco.MjData(model)
    data.qpos[:] = Q0
    out = []
    for goal in goals:
        data.ctrl[:] = goal
        mujoco.mj_step(model, data)
        out.append(data.qpos.copy())
    return np.array(out)


def test_servos_follow_their_goals_in_plain_mujoco_as_in_our_rollouts(tmp_path):
    """Step by step, with a bias and a gain behind the loop, and less apart at a finer step."""
    servo = {"natural_frequency": 20.0, "damping_ratio": 0.6, "gain": 1.05}
    effects = [EffectInstance.of("servo", f"joint{j}", **servo) for j in (2, 4)]
    more = [EffectInstance.of("joint_bias", "joint4", torque=3.0), EffectInstance.of("torque_gain", "joint2", gain=0.8)]
    world = World("iiwa14").add(*effects, *more)
    model, made = written(world, tmp_path)
    assert made.left_out == () and made.native == world.effects
    apart, step = [], float(model.opt.timestep)
    for h in (step, step / 4):
        time = h * np.arange(round(0.6 / h))
        goals = Q0 + 0.2 * np.sin(2 * np.pi * time)[:, None]
        model.opt.timestep = h
        plant = Plant(ROBOT, [world], h, h, 1, servo=True)
        plant.start(Q0[None], np.zeros((1, 7)), np.zeros((1, 7)), np.ones((1, 7)))
        servos, out = Servos(plant), []
        for goal in goals:
            plant.read()
            plant.step(servos.torque(goal[None]), 0.0)
            out.append(plant.qpos[0, plant.qadr].copy())
        apart.append(np.abs(np.array(out) - followed(model, goals)).max())
    moved = np.abs(np.array(out) - Q0).max()
    assert moved > 0.2 and apart[0] < 0.01 * moved and apart[1] < 0.4 * apart[0], (moved, apart)


def test_a_model_of_ones_own_file_is_exported_with_what_its_motors_do(tmp_path):
    """Its robot is a path, and no name that anybody knows."""
    (tmp_path / "mine.xml").write_text(to_mjcf(World("iiwa14")).xml)
    world = World(str(tmp_path / "mine.xml")).add(EffectInstance.of("joint_bias", "joint4", torque=2.0))
    made = export_model(world, tmp_path / "out.xml", "mjcf")
    assert [*made.native] == ["joint_bias(joint4)"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    assert model.actuator("joint4").biasprm[0] == 2.0


def test_what_cannot_be_held_is_named(tmp_path):
    world = World("iiwa14").add(big("payload"), big("stribeck_friction"), big("encoder_offset"))
    _, made = written(world, tmp_path)
    assert [e.effect for e in made.native] == ["payload"]
    assert [e.effect for e in made.left_out] == ["stribeck_friction", "encoder_offset"]
    assert "/work" not in made.xml and str(ROBOT.source) not in made.xml


def test_the_model_of_the_viewer_is_the_one_that_is_written(tmp_path):
    world = World("iiwa14").add(big("coulomb_friction"), big("backlash"))
    shown, left_out = compiled_with(world)
    model, _ = written(world, tmp_path)
    assert [e.effect for e in left_out] == ["backlash"] and shown.nv == model.nv
    assert np.array_equal(shown.dof_frictionloss, model.dof_frictionloss) and shown.dof_frictionloss.any()


def test_a_cell_is_written_whole_and_touches_as_ours_does(tmp_path):
    hidden = (
        EffectInstance.of("contact_friction", "peg", scale=1.7),
        EffectInstance.of("hole_offset", "fixture", x=0.02, y=-0.01),
        EffectInstance.of("fixture_compliance", "fixture", z=2e-5),
        EffectInstance.of("viscous_friction", "joint4", damping=3.0),
        EffectInstance.of("exposure", "wrist_wide"),
    )
    made = export_model(read_model("peg-cell").add(*hidden), tmp_path / "cell.xml", "mjcf")
    assert len(made.native) == 4 and [*made.left_out] == [hidden[-1].label]
    theirs = mujoco.MjModel.from_xml_path(str(tmp_path / "cell.xml"))
    assert {theirs.camera(i).name for i in range(theirs.ncam)} == {"wrist_wide", "wrist_crop", "external"}
    for name in ("table", "peg", "fixture", "gripper", "wall"):
        theirs.geom(name)

    model = read_model("peg-cell")
    scene, world, h = model_cell(model).scene, World(effects=hidden[:4]), float(theirs.opt.timestep)
    x, y, z = scene.target
    heights = (0.004, -0.03)  # m over the fixture, beside its hole
    q, pressed = (start_angles(scene, np.array([x - 0.01, y - 0.02, z + up + scene.tip, 0, 1, 0, 0])) for up in heights)
    weight = nominal_of(scene.nominal, 1).gravity(q[None])[0]
    stiff = np.array([800, 800, 400, 400, 40, 40, 2.0])
    cell = Cell(scene, [world], h, h, 1, [e.effect for e in world.effects])
    cell.start(q[None], np.zeros((1, 7)), weight[None], np.ones((1, 7)))
    data = mujoco.MjData(theirs)
    at, dof = ([getattr(theirs.joint(j), a)[0] for j in scene.joints] for a in ("qposadr", "dofadr"))
    motors = [theirs.actuator(j).id for j in scene.joints]
    data.qpos[at], last, acc = q, weight, np.zeros(7)
    off, tips, forces = [], [], []
    for _ in range(400):
        cell.read()
        cell.advance((weight + stiff * (pressed - cell.x.q[0]) - 0.04 * stiff * cell.x.dq[0])[None], 1)
        before = data.qvel[dof].copy()
        tau = weight + stiff * (pressed - data.qpos[at]) - 0.04 * stiff * (before + 0.5 * h * acc)
        data.ctrl[motors], last = 0.5 * (tau + last), tau
        mujoco.mj_step(theirs, data)
        acc = (data.qvel[dof] - before) / h
        forces.append([np.linalg.norm(data.sensor("contact").data[-3:]), np.linalg.norm(cell.sensors[0][-3:])])
        off.append(np.abs(data.qpos[at] - cell.qpos[0, cell.qadr]).max())
        tips.append(np.linalg.norm(data.site("peg_tip").xpos - cell.site_position("tip")[0]))
    forces, free = np.array(forces), np.flatnonzero(np.array(forces)[:, 0] > 0)[0]
    assert max(off[:free]) < 1e-6, "rad, in free air"
    assert max(tips) < 1e-4, "m, while it slides"
    plain_n, ours_n = forces[200:].mean(axis=0)
    assert plain_n > 30.0 and abs(plain_n / ours_n - 1) < 0.01, "N"


OWN = """<mujoco><compiler meshdir="assets" texturedir="assets/looks"/><asset><mesh file="visual/skin.stl"/>
  <texture name="wood" type="2d" file="wood.png"/><material name="wood" texture="wood"/></asset>
  <worldbody><body name="a"><joint name="j" axis="0 1 0"/>
    <inertial pos="0 0.02 0.1" mass="4" diaginertia="0.1 0.07 0.05" euler="30 20 10"/>
    <geom type="mesh" mesh="skin" material="wood"/><site name="attachment_site" pos="0 0 0.2"/></body></worldbody>
</mujoco>"""


@pytest.fixture
def own(tmp_path):
    """An arm in a user's own file, in degrees, with its mesh and its texture in folders."""
    folder = tmp_path / "own"
    (folder / "assets" / "visual").mkdir(parents=True)
    (folder / "assets" / "looks").mkdir()
    (folder / "assets" / "visual" / "skin.stl").write_bytes((assets() / "iiwa14" / "link1.stl").read_bytes())
    cv2.imwrite(str(folder / "assets" / "looks" / "wood.png"), np.full((4, 4, 3), (200, 120, 40), np.uint8))
    (folder / "own.xml").write_text(OWN)
    return str(folder / "own.xml")


def test_meshes_and_textures_of_a_file_with_folders_lie_beside_the_export(own, tmp_path):
    made = export_model(World(own), tmp_path / "out" / "arm.xml", "mjcf")
    before = mujoco.MjModel.from_xml_path(own)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "arm.xml"))
    assert np.allclose(model.mesh_vert, before.mesh_vert, atol=1e-6)
    assert np.array_equal(model.tex_data, before.tex_data)
    assert [*made.meshes] == ["arm-meshes/skin.stl", "arm-meshes/texture-wood.png"]


def test_springs_and_inertias_are_those_of_the_plant_in_a_file_of_degrees_and_angles(own, tmp_path):
    spring = EffectInstance.of("cable_spring", "j", stiffness=5.0, reference=0.5)
    world = World(own).add(spring, EffectInstance.of("payload", "flange", mass=2.0, x=0.1, y=0.05))
    export_model(world, tmp_path / "arm.xml", "mjcf")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    assert np.allclose(model.qpos_spring, 0.5, atol=1e-6), "rad"
    plant = Plant(load(own), [world], STEP, STEP, 1)
    quat, inertia = (plant.batch.expanded(f"body_{name}")[0] for name in ("iquat", "inertia"))
    body, full = model.body("a").id, []
    for turn, diagonal in ((quat[body], inertia[body]), (model.body_iquat[body], model.body_inertia[body])):
        matrix = Rotation.from_quat(turn, scalar_first=True).as_matrix()
        full.append(matrix @ np.diag(diagonal) @ matrix.T)
    assert np.allclose(*full, rtol=1e-4, atol=1e-6), "kg m^2"


def test_an_arm_with_bodies_without_a_name_is_exported_with_its_load(tmp_path):
    (tmp_path / "own.xml").write_text(OWN.replace(' name="a"', "").replace("<geom", "<body/><geom", 1))
    world = World(str(tmp_path / "own.xml")).add(EffectInstance.of("payload", "flange", mass=2.0))
    model, _ = compiled_with(world)
    assert model.body_mass.sum() == pytest.approx(6.0)


SPRUNG = """
<mujoco><compiler angle="radian"/><worldbody><body name="base">
  <body name="a"><joint name="free" axis="0 1 0"/><geom size=".1" mass="2"/>
    <body name="b" pos="0 0 -.4"><joint name="sprung" axis="0 1 0" stiffness="20" springref=".5"/>
      <geom size=".1" mass="1"/><site name="flange" pos="0 0 -.2"/></body></body></body></worldbody></mujoco>
"""


@pytest.mark.parametrize("where", ["free", "sprung"])
@pytest.mark.parametrize("stiffness", [0.0, 2.0])
def test_a_cable_adds_its_torque_to_the_springs_of_the_robot(where, stiffness, tmp_path):
    """Passive torques at random angles by MuJoCo: of the file, minus the cable's law at its joint, are the world's."""
    path = tmp_path / "sprung.xml"
    path.write_text(SPRUNG)
    robot = load(path)
    world = World(str(path)).add(EffectInstance.of("cable_spring", where, stiffness=stiffness, reference=0.3))
    plant = Plant(robot, [world], STEP, STEP, 1)
    compiled = robot.compile()
    for name in ("jnt_stiffness", "qpos_spring"):
        getattr(compiled, name)[:] = plant.batch.expanded(name)[0]
    q = np.random.default_rng(3).uniform(-2.0, 2.0, (20, 2))
    expected = -np.array([0.0, 20.0]) * (q - [0.0, 0.5])
    j = robot.joints.index(where)
    expected[:, j] -= stiffness * (q[:, j] - 0.3)
    for model in (compiled, compiled_with(world, robot)[0]):
        data, torque = mujoco.MjData(model), []
        for data.qpos[:] in q:
            mujoco.mj_forward(model, data)
            torque.append(data.qfrc_spring.copy())
        assert np.allclose(torque, expected, atol=1e-4), "N m"


def test_a_turned_body_is_turned_also_if_its_orientation_was_stated_by_angles():
    tilt = EffectInstance.of("hole_tilt", "fixture", roll=0.02)
    scene = model_cell(read_model("peg-cell")).scene

    def stated_by_angles():
        spec = scene.spec()
        spec.body("fixture").alt.type = mujoco.mjtOrientation.mjORIENTATION_EULER
        return spec

    world, turns = read_model("peg-cell").add(tilt), []
    for robot in (scene, replace(scene, build=stated_by_angles)):
        turns.append(compiled_with(world, robot)[0].body("fixture").quat)
    assert np.allclose(*turns, atol=1e-9) and turns[0][1] == pytest.approx(0.01, rel=1e-3)


def test_higher_coefficients_of_damping_and_springs_stay_beside_an_effect(tmp_path):
    path = tmp_path / "sprung.xml"
    path.write_text(SPRUNG.replace('stiffness="20"', 'stiffness="20 5 2" damping="1 .7 .3"'))
    effects = [EffectInstance.of("viscous_friction", "all", damping=2.0)]
    effects += [EffectInstance.of("cable_spring", "all", stiffness=3.0, reference=0.5)]
    model = compiled_with(World(str(path)).add(*effects))[0]
    assert np.array_equal(model.dof_damping, [2.0, 3.0]) and np.array_equal(model.jnt_stiffness, [3.0, 23.0])
    assert np.array_equal(model.dof_dampingpoly, [[0.0, 0.0], [0.7, 0.3]])
    assert np.array_equal(model.jnt_stiffnesspoly, [[0.0, 0.0], [5.0, 2.0]])
