"""An exported URDF has the dynamics of the model that it comes from, and says what it could not hold."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import trimesh

from vispeg.api.export.model import export_model
from vispeg.api.export.urdf import fits, to_urdf
from vispeg.core.effect import EffectInstance, searchable
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.robots.model import load
from vispeg.sim.compiled import flange_pose
from vispeg.sim.export import compiled_with
from vispeg.worlds.world import World

ROBOT = load("iiwa14")
OFFSET = """
<mujoco><compiler angle="radian"/><worldbody><body name="base"><geom type="box" size="0.1 0.1 0.1"/>
  <body name="a" pos="0.1 0 0.2" euler="0.3 0.2 -0.5"><joint name="j1" axis="0 1 0" pos="0.05 0.02 -0.1" range="-2 1"/>
    <inertial pos="0.1 0 -0.2" mass="2" fullinertia="0.03 0.025 0.02 0.002 0.001 -0.003"/>
    <geom type="sphere" size="0.05"/>
    <body name="b" pos="0.3 0 0.1"><joint name="j2" axis="0.6 0 0.8" pos="0 0.1 0"/>
      <inertial pos="0 0.05 0" mass="1" diaginertia="0.01 0.01 0.02"/><geom type="cylinder" size="0.03 0.1"/>
      <site name="flange"/></body></body></body></worldbody></mujoco>
"""


def read(made, folder):
    for name, content in made.meshes.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    (folder / "arm.urdf").write_text(made.xml)
    return mujoco.MjModel.from_xml_path(str(folder / "arm.urdf"))


def torques(model, q, dq, ddq):
    """Inverse dynamics without rotors' inertia, (nv,)."""
    model.dof_armature[:] = 0.0
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse.copy()


def same_dynamics(world, folder):
    made = to_urdf(world)
    theirs, (ours, _) = read(made, folder), compiled_with(World(world.robot, world.tool, made.native))
    assert [theirs.joint(i).name for i in range(theirs.njnt)] == [ours.joint(i).name for i in range(ours.njnt)]
    assert np.allclose(theirs.dof_damping, ours.dof_damping) and np.allclose(
        theirs.dof_frictionloss, ours.dof_frictionloss
    )
    for model in (theirs, ours):
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    rng = stream(0, "urdf")
    for _ in range(5):
        state = rng.uniform(-1, 1, (3, ours.nv)) * [[1.0], [2.0], [5.0]]
        assert np.allclose(torques(theirs, *state), torques(ours, *state), atol=1e-6)
    return made


NATIVE = [
    n
    for n, k in searchable().items()
    if k.family in ("joint", "body")
    and fits(EffectInstance.of(n, k.targets(ROBOT)[-1], **{p: v.start for p, v in k.params.items()}))
]


def test_friction_damping_and_masses_are_what_a_urdf_holds():
    assert {"coulomb_friction", "viscous_friction", "payload", "link_mass"} <= set(NATIVE)
    assert not {"rotor_inertia", "gravity_direction", "stribeck_friction", "backlash"} & set(NATIVE)


@pytest.mark.parametrize("name", NATIVE)
def test_the_arm_with_an_effect_moves_as_the_model_does(name, tmp_path):
    kind = searchable()[name]
    placed = EffectInstance.of(name, kind.targets(ROBOT)[-1], **{p: v.start for p, v in kind.params.items()})
    made = same_dynamics(World(effects=(placed,)), tmp_path)
    assert made.native == (placed,) and not made.left_out and len(made.meshes) > 7


def test_joints_beside_the_bodys_origin_and_turned_bodies(tmp_path):
    (tmp_path / "arm.xml").write_text(OFFSET)
    made = same_dynamics(World(str(tmp_path / "arm.xml")), tmp_path)
    assert 'lower="-2" upper="1"' in made.xml and 'type="continuous"' in made.xml


def test_a_pose_that_a_file_states_at_another_angle_than_zero(tmp_path):
    """Bodies lie in the URDF where they do in the file, at any angles."""
    text = OFFSET.replace('range="-2 1"', 'range="-2 1" ref="0.7"').replace('name="j2"', 'name="j2" ref="-0.4"')
    (tmp_path / "arm.xml").write_text(text)
    made = same_dynamics(World(str(tmp_path / "arm.xml")), tmp_path)
    middles = []
    for model in (read(made, tmp_path), mujoco.MjModel.from_xml_string(text)):
        data = mujoco.MjData(model)
        data.qpos[:] = 0.3, -1.1
        mujoco.mj_kinematics(model, data)
        middles.append(data.xipos[-2:].copy())
    assert np.allclose(*middles, atol=1e-6), "m"


@pytest.mark.parametrize("own", [True, False])
def test_the_flange_is_where_it_was(own, tmp_path):
    """A tool sits at the same place of the arm that is read again."""
    placed = '<site name="flange" pos="0 .1 .2" euler=".3 0 .5"/>'
    (tmp_path / "own.xml").write_text(OFFSET.replace('<site name="flange"/>', placed))
    name = str(tmp_path / "own.xml") if own else "iiwa14"
    robot = load(name)
    (tmp_path / "arm.urdf").write_text(to_urdf(World(name)).xml)
    q = np.linspace(-0.5, 0.8, 3 * len(robot.joints)).reshape(3, -1)
    assert np.allclose(flange_pose(load(tmp_path / "arm.urdf"), q), flange_pose(robot, q), atol=1e-6)


SHAPES = """<mujoco><asset><material name="glass" rgba="0 0 1 .5"/>
  <mesh name="wedge" vertex="0 0 0 .1 0 0 0 .2 0 0 0 .3 .02 .03 .04"/>
  <mesh name="grip/wedge" file="wedge.obj" scale=".5 -2 1" refpos=".3 .1 0" refquat="1 1 0 0"/></asset>
  <worldbody><geom name="foot" type="box" size=".1 .1 .2" pos="0 0 -.2"/>
  <body name="a"><joint name="j" axis="0 1 0" pos="0 0 .1"/><geom type="box" size=".1 .2 .3" euler="0 0 30"/>
  <geom type="mesh" mesh="grip/wedge" group="3" pos="0 .1 0" euler="10 0 0"/>
  <geom type="cylinder" size=".02" fromto="0 0 0 .3 0 .4" contype="0" conaffinity="0" group="2" material="glass"/>
  <body name="b"><joint name="k"/><geom type="mesh" mesh="wedge" pos=".1 0 0" euler="0 40 0" rgba="1 0 0 1"/>
  <geom type="sphere" size=".3" contype="0" conaffinity="0" group="4" mass="0"/><site name="flange"/></body></body>
  </worldbody></mujoco>"""


def boxes(model, geoms):
    """Middles and half extents along the world's axes, (n, 6) m."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turn, local = data.geom_xmat[geoms].reshape(-1, 3, 3), model.geom_aabb[geoms]
    middle = data.geom_xpos[geoms] + (turn @ local[:, :3, None])[..., 0]
    return np.hstack([middle, (np.abs(turn) @ local[:, 3:, None])[..., 0]])


def test_a_simulator_that_reads_it_draws_what_is_drawn_and_collides_with_what_collides(tmp_path):
    """Shapes turned by angles, between two points, fixed to the world, and meshes that a file moves, turns or mirrors.

    Of a body with shapes for display only, those are drawn.
    """
    trimesh.creation.box((0.1, 0.2, 0.3)).apply_translation((0.3, 0.1, 0)).export(tmp_path / "wedge.obj")
    (tmp_path / "arm.xml").write_text(SHAPES)
    made = to_urdf(World(str(tmp_path / "arm.xml")))
    assert [*made.meshes] == ["meshes/wedge.stl", "meshes/grip-wedge.stl"] and not made.lacking
    keep = '<mujoco><compiler discardvisual="false" strippath="false"/></mujoco>'
    text = made.xml.replace('<robot name="arm">', f'<robot name="arm">{keep}')
    theirs, ours = read(replace(made, xml=text), tmp_path), mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    collides = theirs.geom_contype > 0
    assert np.allclose(boxes(theirs, collides), boxes(ours, [0, 1, 2, 4]), atol=1e-6), "m"
    assert np.allclose(boxes(theirs, ~collides), boxes(ours, [0, 3, 4]), atol=1e-6), "m"
    assert np.allclose(theirs.geom_rgba[~collides], [[0.5, 0.5, 0.5, 1], [0, 0, 1, 0.5], [1, 0, 0, 1]])


@pytest.mark.parametrize("shape", ['capsule" size=".05 .12', 'ellipsoid" size=".05 .12 .2'])
def test_a_capsule_and_an_ellipsoid_touch_what_they_touched(shape, tmp_path):
    """Rays from all around meet the shapes of the URDF where they meet the shape of the model."""
    text = OFFSET.replace('type="sphere" size="0.05', f'pos=".1 .2 .3" euler=".3 .2 .5" type="{shape}')
    (tmp_path / "arm.xml").write_text(text)
    made = to_urdf(World(str(tmp_path / "arm.xml")))
    models, met = (mujoco.MjModel.from_xml_string(text), read(made, tmp_path)), []
    assert not made.lacking and models[0].ngeom == 3
    data = mujoco.MjData(models[0])
    mujoco.mj_kinematics(models[0], data)
    middle, rng = data.geom_xpos[1].copy(), stream(0, "around")
    ways, aside = rng.normal(size=(200, 3)), rng.uniform(-0.1, 0.1, (200, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)  # begin 1 m away
    for model in models:
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        rays = zip(middle + aside - ways, ways, strict=True)
        hits = [mujoco.mj_ray(model, data, at, way, None, 1, -1, np.zeros(1, np.int32)) for at, way in rays]
        met.append(np.array(hits))
    assert (met[0] > 0).sum() > 100
    both = (met[0] > 0) & (met[1] > 0)
    assert (both != (met[0] > 0)).sum() <= 2 and np.allclose(*(m[both] for m in met), atol=2e-3), "m"


@pytest.mark.parametrize("to", ["urdf", "mjcf"])
def test_the_name_of_a_mesh_leads_to_no_other_folder(to, tmp_path):
    (tmp_path / "deep/er").mkdir(parents=True)
    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "deep/er/wedge.obj")
    (tmp_path / "deep/er/arm.xml").write_text(SHAPES.replace("grip/wedge", "../../../wedge"))
    out = export_model(tmp_path / "deep/er/arm.xml", tmp_path / f"deep/er/new.{ {'mjcf': 'xml'}.get(to, to) }", to)
    assert {path.parent.name for path in tmp_path.rglob("*wedge*")} == {"er", "new-meshes"}
    assert load(out.file).joints == ("j", "k"), "it can be read again"


def test_an_arm_without_shapes_that_collide_is_said_to_be_one(tmp_path):
    (tmp_path / "arm.xml").write_text(OFFSET.replace("<geom", '<geom contype="0" conaffinity="0"'))
    with pytest.warns(UserWarning, match="no shape of the model collides"):
        out = export_model(tmp_path / "arm.xml", tmp_path / "arm.urdf", "urdf")
    assert "<collision" not in out.file.read_text()


def test_what_urdf_cannot_say_is_named_and_two_joints_in_a_body_are_refused(tmp_path):
    backlash = EffectInstance.of(
        "backlash", "joint2", **{k: p.start for k, p in searchable()["backlash"].params.items()}
    )
    assert to_urdf(World(effects=(backlash,))).left_out == (backlash,)
    two = OFFSET.replace('<joint name="j2"', '<joint name="j3" axis="1 0 0"/><joint name="j2"')
    (tmp_path / "two.xml").write_text(two)
    with pytest.raises(UserError, match="b: has no URDF.*2 joints"):
        to_urdf(World(str(tmp_path / "two.xml")))


COUPLED = (
    OFFSET.replace('range="-2 1"', 'range="-2 1" ref="0.7"')
    .replace('name="j2"', 'name="j2" ref="-0.4"')
    .replace("</mujoco>", "<equality><joint joint1='j2' joint2='j1' polycoef='.1 -.7 0 0 0'/></equality></mujoco>")
)


def test_a_joint_that_follows_another_does_so_in_the_urdf_and_when_that_is_read(tmp_path):
    (tmp_path / "arm.xml").write_text(COUPLED)
    made = to_urdf(World(str(tmp_path / "arm.xml")))
    assert '<mimic joint="j1"' in made.xml and not made.lacking
    (tmp_path / "off.xml").write_text(COUPLED.replace("<joint joint1", "<joint active='false' joint1"))
    off = to_urdf(World(str(tmp_path / "off.xml")))
    assert "<mimic" not in off.xml and not off.lacking, "what is off couples nothing"
    (tmp_path / "again.urdf").write_text(made.xml)
    off = []
    for model in (mujoco.MjModel.from_xml_string(COUPLED), load(tmp_path / "again.urdf").compile()):
        data, found = mujoco.MjData(model), []
        for data.qpos[:] in stream(0, "coupled").uniform(-0.5, 0.5, (5, 2)):
            mujoco.mj_forward(model, data)
            found.append(data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY].tolist())
        off.append(found)
    assert np.shape(off) == (2, 5, 1), "it is coupled once"
    assert np.allclose(*off, atol=1e-9) and np.ptp(off) > 0.1


def test_what_of_a_file_urdf_has_no_element_for_is_said(tmp_path, capsys):
    from vispeg.cli.main import run

    tendon = "<tendon><fixed name='rope'><joint joint='j1' coef='1'/></fixed></tendon>"
    option = "<option gravity='0 0 -1.62' density='1.2'/></mujoco>"
    text = COUPLED.replace("-.7 0 0 0", "-.7 .2 0 0").replace('name="j2"', 'name="j2" stiffness="3" damping="1 2"')
    text = text.replace("</worldbody>", '<geom type="plane" size="1 1 1"/></worldbody>')
    (tmp_path / "arm.xml").write_text(text.replace("</mujoco>", tendon + option))
    made = to_urdf(World(str(tmp_path / "arm.xml")))
    springs, *others, gravity, medium = made.lacking
    assert (springs, gravity) == ("springs of j2", "gravity of 0 0 -1.62 m/s^2") and medium.startswith(
        "a medium of 1.2"
    )
    assert others == ["damping that grows with speed of j2", "couplings equality1", "tendons rope", "shapes plane"]
    assert run(["export", str(tmp_path / "arm.xml"), "--to", "urdf", "--out", str(tmp_path / "arm.urdf")]) == 0
    assert f"URDF has no element for it: {'; '.join(made.lacking)}" in " ".join(capsys.readouterr().out.split())


def test_the_command_writes_the_file_its_meshes_and_what_is_not_in_it(tmp_path, capsys):
    from vispeg.cli.main import run
    from vispeg.worlds.model_file import model_text

    effects = (
        EffectInstance.of("coulomb_friction", "joint4", torque=1.2),
        EffectInstance.of("rotor_inertia", "joint1"),
    )
    (tmp_path / "m.yaml").write_text(model_text(World(effects=effects)))
    assert run(["export", str(tmp_path / "m.yaml"), "--to", "urdf", "--out", str(tmp_path / "arm.urdf")]) == 0
    said = capsys.readouterr().out
    assert "in it: coulomb_friction(joint4)" in said and "URDF has no element for it: rotor_inertia(joint1)" in said
    text = (tmp_path / "arm.urdf").read_text()
    assert (
        'friction="1.2"' in text and "rotor_inertia(joint1)" in text and (tmp_path / "arm-meshes/link1.stl").is_file()
    )
    assert load(tmp_path / "arm.urdf").joints == ROBOT.joints, "it can be read again"
    with pytest.raises(UserError, match=r"a name that ends in \.urdf"):
        run(["export", "iiwa14", "--to", "urdf", "--out", str(tmp_path / "arm.xml")])
