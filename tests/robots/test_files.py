"""Arms from a user's URDF or MJCF, whole or with files missing."""

import hashlib
import os
import re
import sys
import traceback
import urllib.error
import urllib.request
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from robots import arms

from vispeg.core.errors import UserError
from vispeg.robots import menagerie
from vispeg.robots.declare import RobotConfig
from vispeg.robots.model import available, load, load_for
from vispeg.robots.scene import build
from vispeg.robots.scene_config import SceneConfig
from vispeg.task.world_file import world_hash
from vispeg.task.world_robot import identity
from vispeg.worlds.world import World

SHARED = Path(os.environ.get("VISPEG_SHARED", Path(__file__).resolve().parents[3] / "shared"))
LWR4 = SHARED / "data" / "kuka-lwr4" / "kuka_lwr4.urdf"

LINK = """<link name="{0}"><inertial><origin xyz="0.1 0 0.2" rpy="0.3 0 0"/><mass value="2"/>
  <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="0" iyz="0"/></inertial>
  <visual><geometry><mesh filename="{1}"/></geometry></visual>
  <collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>"""
URDF = (
    """<robot name="two"><link name="world_link"/>"""
    + LINK.format("upper", "package://two_description/meshes/upper.stl")
    + LINK.format("lower", "missing.dae")
    + """<link name="tool0"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <joint name="shoulder" type="revolute"><parent link="world_link"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" effort="50" velocity="3"/><dynamics damping="4" friction="5"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0 0 0.4"/>
    <axis xyz="0 1 0"/><limit effort="0" velocity="0"/></joint>
  <joint name="tip" type="fixed"><parent link="lower"/><child link="tool0"/><origin xyz="0 0 0.3"/></joint></robot>"""
)
MJCF = """<mujoco><compiler meshdir="meshes"/><asset><mesh name="skin" file="skin.stl"/></asset>
  <worldbody><body name="a">{inertial}<joint name="j" axis="0 1 0" damping="3" armature="0.2" range="-90 90"/>
    <geom type="mesh" mesh="skin"/><geom name="own" type="sphere" size="0.1"/>
    <body name="b" pos="0 0 0.5"><inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/>
      <joint name="k" axis="0 1 0"/><geom name="near" type="sphere" size="0.5"/>
      <site name="attachment_site" pos="0 0 0.2" euler="90 0 0"/>
      <body name="finger"><inertial pos="0 0 0.1" mass="0.1" diaginertia="0.001 0.001 0.001"/>
        <joint name="slide" type="slide" range="0 0.04"/></body></body></body></worldbody>
  <equality><joint joint1="slide" polycoef="0.01 0 0 0 0"/></equality>
  <actuator><position name="servo" joint="j" kp="100" forcerange="-60 60"/>
    <motor name="m" joint="k" gear="10" ctrlrange="-2 2"/></actuator>
  <keyframe><key qpos="0 0 0" ctrl="0 0"/></keyframe></mujoco>"""
INERTIAL = '<inertial pos="0 0 0.1" mass="4" diaginertia="0.1 0.1 0.1"/>'


def write(folder, text, name):
    path = folder / name
    path.write_text(text)
    return path


def test_urdf_keeps_every_link_and_guesses_no_mass(tmp_path):
    arm = load(write(tmp_path, URDF, "two.urdf"))
    model = arm.compile()
    assert arm.joints == ("shoulder", "elbow") and arm.links == ("upper", "lower") and arm.base == "world_link"
    assert model.body("tool0").mass[0] == 0.0  # it has a shape, but states no mass
    assert model.body_mass.sum() == 4.0
    np.testing.assert_array_equal(arm.torque_limit, [50, np.inf])
    np.testing.assert_array_equal(arm.velocity_limit, [3, np.inf])
    np.testing.assert_array_equal(arm.range, [[-1, 2], [-np.inf, np.inf]])
    assert not model.dof_damping.any() and not model.dof_frictionloss.any() and not model.jnt_actfrclimited.any()


def test_meshes_that_are_left_out_are_named(tmp_path):
    """Those of a package that is not there, and those that MuJoCo does not read; a mesh that is there is used."""
    write(tmp_path, "<COLLADA/>", "skin.dae")
    path = write(tmp_path, URDF.replace("missing.dae", "skin.dae"), "two.urdf")
    with pytest.warns(UserWarning) as notes:
        load(path)
    absent, unread = (str(n.message) for n in notes)
    assert "upper.stl (visual of upper)" in absent and "ROS_PACKAGE_PATH" in absent and "skin.dae" not in absent
    assert "skin.dae (visual of lower)" in unread and ".stl" in unread and "upper" not in unread
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "skin.stl")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ("skin.stl", "file://skin.stl", f"package://{tmp_path.name}/skin.stl"):
            text = re.sub('filename="[^"]*"', f'filename="{name}"', URDF)
            assert load(write(tmp_path, text, "whole.urdf")).compile().nmesh == 1


@pytest.mark.parametrize(
    "was, now",
    [
        ("<worldbody>", '<option timestep="0.01"><flag frictionloss="disable" damper="disable"/></option><worldbody>'),
        ("<worldbody>", '<option iterations="1" ls_iterations="4"><flag contact="disable"/></option><worldbody>'),
        ("<worldbody>", '<option><flag actuation="disable" constraint="disable"/></option><worldbody>'),
        ('<joint name="k"', '<joint name="k" actuatorfrcrange="-0.5 0.5"'),
        ('<body name="b"', '<body name="b" gravcomp="1"'),
    ],
)
def test_mjcf_settings_of_its_own_scene_do_not_act(tmp_path, was, now):
    """Torques, friction, weight and contact act on the arm as if the file did not switch off or limit them."""
    text, states = MJCF.format(inertial=INERTIAL).replace("damping", 'frictionloss="0.3" damping'), []
    for name, stated in (("plain", text), ("set", text.replace(was, now))):
        spec = load(write(tmp_path, stated, f"{name}.xml")).spec()
        ball = spec.worldbody.add_body(name="ball", pos=(0.12, 0, 0.6))
        ball.add_geom(size=(0.1, 0, 0))
        model = spec.compile()
        data = mujoco.MjData(model)
        data.ctrl[:], data.qvel[:2] = (2.0, 3.0), (0.5, -0.2)
        mujoco.mj_step(model, data, 20)
        states.append((model.opt.timestep, data.ncon > 0, *data.qpos))
    np.testing.assert_array_equal(*states)


def test_mjcf_gravity_that_is_disabled_is_none(tmp_path):
    option = '<option gravity="0 1 -9"{}</option><worldbody>'
    text = MJCF.format(inertial=INERTIAL)
    for flag, gravity in ((">", (0, 1, -9)), ('><flag gravity="disable"/>', (0, 0, 0))):
        arm = load(write(tmp_path, text.replace("<worldbody>", option.format(flag)), "g.xml"))
        np.testing.assert_array_equal(arm.compile().opt.gravity, gravity)


@pytest.mark.parametrize(
    "stated, low, high", [('upper="2"', 0, 2), ('lower="-1"', -1, 0), ('lower="" upper="2"', 0, 2)]
)
def test_urdf_limit_that_is_missing_is_zero(tmp_path, stated, low, high):
    arm = load(write(tmp_path, URDF.replace('lower="-1" upper="2"', stated), "two.urdf"))
    np.testing.assert_array_equal(arm.range, [[low, high], [-np.inf, np.inf]])


def test_urdf_inertia_is_turned_as_stated(tmp_path):
    """The shoulder's inertia at rest, by hand: both links about the y axis, R I R' and parallel axes."""
    model = load(write(tmp_path, URDF, "two.urdf")).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    full = np.zeros((2, 2))
    mujoco.mj_fullM(model, data, full)
    c, s = np.cos(0.3), np.sin(0.3)
    about_y = 0.03 * c**2 + 0.04 * s**2
    lower = about_y + 2 * (0.1**2 + 0.2**2)
    assert full[1, 1] == pytest.approx(lower)
    assert full[0, 0] == pytest.approx(lower + about_y + 2 * (0.1**2 + 0.6**2))


def test_urdf_massless_link_between_joints_changes_nothing(tmp_path):
    """A dummy link that splits a joint in two is kept, and the arm around it weighs and swings as before."""
    dummy = """<link name="dummy"/><joint name="twist" type="revolute"><parent link="upper"/><child link="dummy"/>
      <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="5" velocity="1"/></joint><link name="tool0">"""
    text = URDF.replace('<parent link="upper"/>', '<parent link="dummy"/>').replace('<link name="tool0">', dummy)
    arm, plain = load(write(tmp_path, text, "d.urdf")), load(write(tmp_path, URDF, "two.urdf"))
    assert arm.joints == ("shoulder", "twist", "elbow")
    found = []
    for model, keep in ((arm.compile(), [0, 2]), (plain.compile(), [0, 1])):
        data = mujoco.MjData(model)
        data.qpos[keep] = 0.4, -0.7
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        found.append((full[np.ix_(keep, keep)], data.qfrc_bias[keep]))
    np.testing.assert_allclose(found[0][0], found[1][0], atol=1e-8)
    np.testing.assert_allclose(found[0][1], found[1][1], atol=1e-7)


THREE = (
    '<robot name="three">{compiler}<link name="base"/>'
    + "".join(
        f'<link name="l{i}"><inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/>'
        f'<inertia ixx="{a}" iyy="{b}" izz="{c}" ixy="{d}" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="j{i}" type="revolute"><parent link="{"l" + str(i - 1) if i > 1 else "base"}"/>'
        f'<child link="l{i}"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="9" velocity="3"/></joint>'
        for i, x, mass, a, b, c, d in (
            (1, 0.15, 2.0, 0.002, 0.008, 0.011, 0),  # A + B < C
            (2, 0.1, 0.8, 0.003, 0.004, 0.005, 0.001),  # as a body has it
            (3, 0.04, 0.2, 0, 0, 0, 0),
            (4, 0.02, 0.1, 0.001, 0.001, 0.001, 0.002),  # one moment below zero
        )
    )
    + "</robot>"
)
CURE = '<mujoco><compiler balanceinertia="true" boundinertia="1e-6" boundmass="0.15"/></mujoco>'


@pytest.mark.parametrize(("compiler", "said"), [("", "l1 .*l3 .*l4"), (CURE, None)])
def test_urdf_inertias_that_no_body_has_are_mended_as_mujoco_would(tmp_path, compiler, said):
    text = THREE.format(compiler=compiler)
    if said:
        with pytest.warns(UserWarning, match=said) as notes:
            model = load(write(tmp_path, text, "three.urdf")).compile()
        assert len(notes) == 1 and "l2" not in str(notes[0].message)
    else:
        model = load(write(tmp_path, text, "three.urdf")).compile()
        assert model.body("l3").inertia == pytest.approx(1e-6)  # what the file asks for survives
        assert model.body("l4").mass[0] == 0.15
    assert model.body("l1").inertia == pytest.approx(0.007) and model.body("l1").mass[0] == 2.0
    kept = np.linalg.eigvalsh([[0.003, 0.001, 0], [0.001, 0.004, 0], [0, 0, 0.005]])
    assert np.sort(model.body("l2").inertia) == pytest.approx(kept, rel=1e-6)
    theirs = mujoco.MjModel.from_xml_string(THREE.replace('ixy="0.002"', 'ixy="0"').format(compiler=CURE))
    assert model.body("l1").inertia == pytest.approx(theirs.body("l1").inertia)


def test_urdf_of_another_program_or_without_a_base_says_what_to_do(tmp_path):
    xacro = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a"><xacro:include filename="b.xacro"/></robot>'
    for name, out in (("arm.urdf", "arm-expanded.urdf"), ("arm.urdf.xacro", "arm.urdf")):  # not onto itself
        with pytest.raises(UserError, match=rf"needs xacro; expected its result: xacro {name} > {out}$"):
            load(write(tmp_path, xacro, name))
    with pytest.raises(UserError, match="j1: a floating joint; expected a base that stands still"):
        load(write(tmp_path, THREE.format(compiler="").replace("revolute", "floating", 1), "free.urdf"))


def test_urdf_flange_is_the_link_beyond_the_last_joint_where_nothing_is_called_so(tmp_path):
    end = '<link name="arm_link5"/><joint name="e" type="fixed"><parent link="l4"/><child link="arm_link5"/>'
    text = THREE.format(compiler=CURE).replace("</robot>", end + '<origin xyz="0 0 0.107"/></joint></robot>')
    model = load(write(tmp_path, text, "five.urdf")).compile()
    assert model.body(model.site("flange").bodyid[0]).name == "arm_link5"


def test_urdf_flange_is_its_tool0_frame(tmp_path):
    arm = load(write(tmp_path, URDF, "two.urdf"))
    model = arm.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.site(arm.flange).xpos, [0, 0, 0.7], atol=1e-15)


def test_urdf_flange_is_on_the_wrist_where_fingers_turn(tmp_path):
    """Of an arm with a gripper whose finger is a hinge: what hangs at its flange does not turn with the finger."""
    finger = """<link name="finger"><inertial><mass value="0.05"/><origin xyz="0 0 0.02"/>
      <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="finger_joint" type="revolute"><parent link="tool0"/><child link="finger"/><axis xyz="0 1 0"/>
      <origin xyz="0 0.03 0.05"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"""
    tool = {"mass_kg": 2.0, "com_m": [0, 0, 0], "inertia_kgm2": [0, 0, 0]}
    arm = load(write(tmp_path, URDF.replace("</robot>", finger), "hand.urdf"), tool=tool)
    model = arm.compile()
    assert arm.joints[-1] == "finger_joint"
    assert model.body(model.body("tool").parentid[0]).name == "tool0"


def test_urdf_mesh_found_through_its_package(tmp_path, monkeypatch):
    from vispeg.core.assets import assets

    folder = tmp_path / "two_description"
    (folder / "meshes").mkdir(parents=True)
    (folder / "urdf").mkdir()
    (folder / "meshes" / "upper.stl").write_bytes((assets() / "iiwa14" / "link1.stl").read_bytes())
    assert load(write(folder / "urdf", URDF, "two.urdf")).compile().nmesh == 1  # by the parent folders
    other = tmp_path / "elsewhere"
    other.mkdir()
    assert load(write(other, URDF.replace("two_desc", "no_desc"), "two.urdf")).compile().nmesh == 0
    deep = tmp_path / "x"
    deep.mkdir()
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    assert load(write(deep, URDF, "two.urdf")).compile().nmesh == 1


@pytest.mark.skipif(not LWR4.is_file(), reason="the shared LWR4 recordings are not here")
def test_lwr4_loads_without_its_meshes():
    arm = load(LWR4)
    model = arm.compile()
    assert arm.joints == tuple(f"lwr_{i}_joint" for i in range(7))
    np.testing.assert_array_equal(arm.torque_limit, [176, 176, 100, 100, 100, 38, 38])
    moving = [model.body(b).mass[0] for b in arm.links]
    np.testing.assert_array_equal(moving, [2.7, 2.7, 2.7, 2.7, 1.7, 1.1, 0.25])
    assert model.nmesh == 0 and not model.dof_frictionloss.any()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0  # its shapes overlap


def test_a_motor_that_pulls_one_way_has_the_torque_of_that_way(tmp_path):
    """By each of the three ranges that a file may state."""
    text = MJCF.format(inertial=INERTIAL).replace("-60 60", "-50 0").replace("-2 2", "-3 1")
    np.testing.assert_array_equal(load(write(tmp_path, text, "arm.xml")).torque_limit, [50, 30])
    text = text.replace('name="k" axis', 'name="k" actuatorfrcrange="-25 -5" axis')
    np.testing.assert_array_equal(load(write(tmp_path, text, "own.xml")).torque_limit, [50, 25])


def test_mjcf_keeps_what_it_states_and_gets_motors(tmp_path):
    arm = load(write(tmp_path, MJCF.format(inertial=INERTIAL), "arm.xml"))
    model = arm.compile()
    assert arm.joints == ("j", "k")
    assert model.nv == 2 and model.neq == 0 and model.nkey == 0  # the finger is fixed
    np.testing.assert_array_equal(model.dof_damping, [3, 0])
    np.testing.assert_array_equal(model.dof_armature, [0.2, 0])
    np.testing.assert_array_equal(arm.torque_limit, [60, 20])  # force range; control range times gear
    np.testing.assert_allclose(arm.range, [[-np.pi / 2, np.pi / 2], [-np.inf, np.inf]])
    assert [model.actuator(i).name for i in range(model.nu)] == ["j", "k"]
    np.testing.assert_array_equal(model.actuator_gear[:, 0], 1)
    data = mujoco.MjData(model)
    data.ctrl[:] = [500, 700]
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.qfrc_actuator, [500, 700])
    assert data.ncon == 0
    site = data.site(arm.flange)
    np.testing.assert_allclose(site.xpos, [0, 0, 0.7])
    np.testing.assert_allclose(site.xmat.reshape(3, 3)[:, 2], [0, -1, 0], atol=1e-15)


def test_mjcf_whose_mass_is_in_a_missing_mesh_is_refused(tmp_path):
    with pytest.raises(UserError, match="mass of body 'a' comes from a mesh that is missing"):
        load(write(tmp_path, MJCF.format(inertial=""), "arm.xml"))


def test_the_mass_of_the_fixed_base_may_be_in_a_missing_mesh(tmp_path):
    """It cannot move, so its mass changes nothing; that of a body that a joint moves would."""
    whole = MJCF.format(inertial=INERTIAL).replace('<geom type="mesh" mesh="skin"/>', "")
    base = '<worldbody><body name="pedestal"><geom type="mesh" mesh="skin"/><body name="plate">'
    text = whole.replace("<worldbody>", base + '<geom type="mesh" mesh="skin"/>')
    text = text.replace("</worldbody>", "</body></body></worldbody>")
    arm, model = (load(write(tmp_path, t, f"{i}.xml")) for i, t in enumerate((text, whole)))
    assert arm.joints == model.joints and arm.compile().nmesh == 0
    np.testing.assert_array_equal(arm.compile().body("a").mass, model.compile().body("a").mass)
    held = text.replace('<body name="plate">', '<body name="plate"><joint name="turn" axis="0 0 1"/>')
    with pytest.raises(UserError, match="mass of body 'plate' comes from a mesh that is missing"):
        load(write(tmp_path, held, "held.xml"))


HAND = """<mujoco><compiler angle="radian"/><worldbody><body name="a"><joint name="j" axis="0 1 0"/>
<geom size=".05" pos=".2 0 0" mass="2"/><body name="b" pos=".4 0 0"><joint name="k" axis="0 1 0"/>
<geom size=".03" pos=".1 0 0" mass="1"/><body name="f" pos=".2 0 0"><joint name="left" axis="0 1 0"/>
<geom size=".01" pos="0 0 .03" mass=".3"/></body><body name="g" pos=".2 0 0"><joint name="right" axis="0 1 0"/>
<geom size=".01" pos="0 0 -.03" mass=".3"/></body></body></body></worldbody>
<equality><joint joint1="left" joint2="right"/></equality></mujoco>"""


def test_joints_that_a_log_lacks_are_held_at_rest_and_their_mass_stays(tmp_path):
    path = write(tmp_path, HAND, "hand.xml")
    with pytest.warns(UserWarning, match="lacks 2 of the robot's joints: held at rest, their mass stays: left, right"):
        arm = load_for(("j", "k"), path)
    assert arm.joints == ("j", "k") and arm.links == ("a", "b")
    found = []
    for model in (arm.compile(), load(path).compile()):
        data = mujoco.MjData(model)
        data.qpos[:2] = 0.4, -0.7
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        found.append((full[:2, :2], data.qfrc_bias[:2], model.site_bodyid[model.site(arm.flange).id]))
    np.testing.assert_allclose(found[0][0], found[1][0], atol=1e-12)
    np.testing.assert_allclose(found[0][1], found[1][1], atol=1e-12)
    assert arm.compile().neq == 0 and arm.compile().body(found[0][2]).name == "b"  # no finger is the flange
    for joints in (("j", "k", "left", "right"), ("j", "other"), ()):
        assert load_for(joints, path) is load(path)


UNNAMED = """<mujoco><worldbody><body pos="5 0 0"><geom size=".1"/></body>
  <body pos="0 0 1"><joint axis="0 1 0"/><geom size=".1"/>
  <body name="link1" pos="0 0 -.4"><joint name="joint1" axis="0 1 0"/><geom size=".1"/>
  <body pos="0 0 -.4"><site name="attachment_site"/></body></body></body></worldbody></mujoco>"""


def test_bodies_and_joints_without_a_name_get_one_and_the_flange_lies_where_the_file_has_it(tmp_path):
    """The names that the file gives stay with the elements that it gives them to."""
    arm = load(write(tmp_path, UNNAMED, "unnamed.xml"))
    model = arm.compile()
    assert len({model.body(b).name for b in range(model.nbody)} - {""}) == model.nbody
    assert arm.joints[1] == "joint1" and arm.links[1] == "link1" and "" not in arm.joints
    data = mujoco.MjData(model)
    data.qpos[:] = 0.3, -0.8
    mujoco.mj_kinematics(model, data)
    np.testing.assert_array_equal(data.site("flange").xpos, data.site("attachment_site").xpos)


def test_an_edited_file_is_read_again(tmp_path):
    path = write(tmp_path, URDF, "two.urdf")
    first = load(path)
    assert load(path) is first
    path.write_text(URDF.replace('mass value="2"', 'mass value="3"'))
    os.utime(path, ns=(1, 1))
    assert load(path).compile().body_mass.sum() == 6.0


def test_an_edited_part_of_a_file_is_read_again_and_is_another_robot(tmp_path):
    """Also a part of a part; the identity of a file alone is that of its bytes."""
    path = write(tmp_path, '<mujoco><worldbody><include file="a.xml"/></worldbody></mujoco>', "whole.xml")
    write(tmp_path, '<mujocoinclude><include file="b.xml"/></mujocoinclude>', "a.xml")
    link = '<mujocoinclude><body><joint name="j"/>{}<site name="flange"/></body></mujocoinclude>'
    write(tmp_path, link.format(INERTIAL), "b.xml")
    first, before = load(path), identity(str(path))
    assert load(path) is first
    write(tmp_path, link.format(INERTIAL.replace('mass="4"', 'mass="5"')), "b.xml")
    os.utime(tmp_path / "b.xml", ns=(1, 1))
    assert load(path).compile().body_mass.sum() == 5.0 and identity(str(path)) != before
    alone = write(tmp_path, MJCF, "alone.xml")
    assert identity(str(alone)) == hashlib.sha256(alone.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("name", "text", "mesh"),
    [
        ("arm.xml", MJCF.format(inertial=INERTIAL), "meshes/skin.stl"),
        ("arm.urdf", URDF, "two_description/meshes/upper.stl"),
    ],
)
def test_an_arm_with_an_edited_mesh_is_another_robot_and_its_world_another_world(tmp_path, name, text, mesh):
    """In one process too: the model that was read before is not used again."""
    path, skin = write(tmp_path, text, name), tmp_path / mesh
    skin.parent.mkdir(parents=True)
    hashes, models = set(), []
    for moment, size in ((1, 0.1), (2, 0.2), (2, 0.2)):
        trimesh.creation.box((size,) * 3).export(skin)
        os.utime(skin, ns=(moment, moment))
        config = {"robot": {"model": str(path)}}
        hashes.add((identity(str(path)), world_hash(World(robot=str(path)), config)))
        models.append(load(path))
    assert len({robot for robot, _ in hashes}) == len({world for _, world in hashes}) == 2
    assert models[0] is not models[1]


def test_meshes_that_are_written_again_and_again_are_the_shapes_of_arm_and_gripper(tmp_path):
    """As a program writes them that tries shapes: several a second. A copy may also keep the time of the old file."""
    text = '<mujoco><asset><mesh name="m" file="m.stl"/></asset><worldbody>'
    text += '<body>{}<geom type="mesh" mesh="m" density="1000"/></body></worldbody></mujoco>'
    arm = write(tmp_path, text.format("<joint/>"), "arm.xml")
    tool = write(tmp_path, text.format('<site name="grasp" pos="0 0 .08"/>'), "grip.xml")
    for size in (0.1, 0.2, 0.3):
        trimesh.creation.box((size,) * 3).export(tmp_path / "m.stl")
        os.utime(tmp_path / "m.stl", ns=(1, 1))
        assert load(arm).compile().body_mass.sum() == pytest.approx(1000 * size**3, rel=1e-5)
        held = load("iiwa14", tool=str(tool)).compile().body_mass.sum() - load("iiwa14").compile().body_mass.sum()
        assert held == pytest.approx(1000 * size**3, rel=1e-5)


def test_a_cell_with_an_edited_arm_or_gripper_is_built_again(tmp_path):
    path = Path(arms.write(tmp_path, "panda", arms.PANDA))
    grip = '<mujoco><worldbody><body><geom type="box" size=".02 .02 .05" pos="0 0 .05" mass="{}"/></body>'
    grip += '<site name="grasp" pos="0 0 .08"/></worldbody></mujoco>'
    tool = write(tmp_path, grip.format(0.5), "grip.xml")
    config = SceneConfig(robot=RobotConfig(model=str(path), tool=str(tool)))
    first = build(config)
    assert build(config) is first
    path.write_text(path.read_text().replace('mass="4.0"', 'mass="5.0"'))
    os.utime(path, ns=(1, 1))
    heavier = build(config)
    assert np.isclose(heavier.compile().body_mass.sum() - first.compile().body_mass.sum(), 1.0)
    write(tmp_path, grip.format(0.8), "grip.xml")
    os.utime(tool, ns=(1, 1))
    assert np.isclose(build(config).compile().body_mass.sum() - heavier.compile().body_mass.sum(), 0.3)


def test_menagerie_by_folder_name(tmp_path, monkeypatch):
    folder = tmp_path / "acme_arm_7"
    folder.mkdir()
    write(folder, MJCF.format(inertial=INERTIAL), "arm7.xml")
    write(folder, "<mujoco/>", "scene.xml")
    write(folder, "<mujoco/>", "aa_hand.xml")
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    assert available() == ["iiwa14", "acme_arm_7"]
    assert load("acme_arm_7").joints == ("j", "k")


def test_short_names_are_arms_and_entries_of_the_package():
    package = pytest.importorskip("mujoco_menagerie")
    for name, entry in menagerie.SHORT.items():
        folder, _, model = entry.partition("/")
        robot = package.get(folder)
        assert robot.category == "arm" and model in robot.entry_names, name


def test_an_arm_is_here_where_its_folder_is(tmp_path, monkeypatch):
    """By a checkout; in what the package keeps; else it downloads, or where there is no package it is not here."""
    package = pytest.importorskip("mujoco_menagerie")
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "kept"))
    assert menagerie.state("so101") == "downloads"
    kept = package.Cache().model_path(package.get("robotstudio_so101"))
    kept.mkdir(parents=True)
    write(kept, MJCF.format(inertial=INERTIAL), "so101.xml")
    (kept / package._cache.SENTINEL).touch()
    assert menagerie.state("so101") == "here" and menagerie.state("so100") == "downloads"
    assert load("so101").joints == ("j", "k")
    root = tmp_path / "root"
    (root / "trs_so_arm100").mkdir(parents=True)
    write(root / "trs_so_arm100", MJCF.format(inertial=INERTIAL), "so_arm100.xml")
    monkeypatch.setenv("MENAGERIE_ROOT", str(root))
    assert menagerie.state("so100") == "here" and menagerie.state("so101") == "not here"
    assert load("so100").joints == ("j", "k") and "so100" in available()
    (root / "robotstudio_so101").mkdir()  # without a model, as in a checkout that was cut short
    for name in ("so101", "robotstudio_so101"):
        with pytest.raises(UserError, match=f"'{name}' is not in MENAGERIE_ROOT .*root.; expected a checkout with it"):
            menagerie.find(name)
    monkeypatch.delenv("MENAGERIE_ROOT")
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)  # not installed
    assert menagerie.state("so101") == "not here"
    with pytest.raises(UserError, match="'so101' is not here.*pip install.*menagerie"):
        load("so101")


def test_an_arm_that_cannot_be_downloaded_shows_no_traceback_of_the_network(tmp_path, monkeypatch):
    """The message says what failed; that it was raised in sockets and HTTP clients adds nothing."""
    pytest.importorskip("mujoco_menagerie")

    def unplugged(*request, **options):
        raise urllib.error.URLError("no network")

    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(urllib.request, "urlopen", unplugged)
    with pytest.raises(UserError, match="cannot get the robot 'unitree_z1'.*no network") as caught:
        load("z1")
    assert "no network" not in "".join(traceback.format_exception(caught.value)[:-1])


FREE = '<mujoco><worldbody><body name="a"><freejoint/><geom size="1"/></body></worldbody></mujoco>'
BARE = '<mujoco><worldbody><geom size="1"/></worldbody></mujoco>'
TIP = re.sub(r"<inertial>.*?</inertial>", "", URDF, flags=re.DOTALL)


@pytest.mark.parametrize(
    "name, text, says",
    [
        ("a.xml", FREE, "fixed-base"),
        ("a.xml", BARE, "no hinge"),
        ("a.xml", "<mujoco", "is not XML"),
        ("a.urdf", "<robot", "is not XML"),
        ("a.urdf", "<mujoco/>", "not a URDF"),
        ("a.urdf", URDF.replace('effort="50"', 'effort="lots"'), "shoulder.effort"),
        ("a.urdf", TIP, "moves no mass"),
    ],
)
def test_bad_files_are_named_in_one_line(tmp_path, name, text, says):
    with pytest.raises(UserError) as error:
        load(write(tmp_path, text, name))
    assert says in str(error.value) and "\n" not in str(error.value) and name in str(error.value)


@pytest.mark.parametrize("robot, says", [("iiwa15", "did you mean 'iiwa14'"), ("no/a.urdf", "no/a.urdf: no such")])
def test_unknown_robots(robot, says, monkeypatch):
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    with pytest.raises(UserError, match=says):
        load(robot)


def test_bad_tilt():
    with pytest.raises(UserError, match="roll and pitch"):
        load("iiwa14", base_tilt=(0.1, float("nan")))
