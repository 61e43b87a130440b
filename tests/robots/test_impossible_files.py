"""Robot files that nobody means: one line that names what is wrong, soon, and nothing is written."""

import os
import time
import warnings

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.robots.examples import write_mjcf, write_urdf
from vispeg.robots.model import load

WRITE = {"urdf": write_urdf, "xml": write_mjcf}
BOMB = '<!DOCTYPE x [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]>'
TWICE = '<joint name="elbow" type="fixed"><parent link="lower"/><child link="x"/></joint><link name="x"/></robot>'


def refused(kind, folder, change, said, monkeypatch):
    path = WRITE[kind](folder)
    text = change(path.read_text())
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    stand = folder / "stand"
    stand.mkdir(exist_ok=True)
    monkeypatch.chdir(stand)
    start = time.monotonic()
    with pytest.raises(UserError, match=said) as error:
        load(path)
    assert time.monotonic() - start < 5
    assert "\n" not in str(error.value) and path.name in str(error.value)
    assert not os.listdir(stand)  # no MUJOCO_LOG.TXT


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('<mass value="2"/>', '<mass value="inf"/>', "upper.mass.value: too large for an arm; expected at most 1e"),
        ('<mass value="2"/>', '<mass value="-2"/>', "upper.mass: negative mass"),
        ('<mass value="2"/>', '<mass value="heavy"/>', "upper.mass.value: not a number; got 'heavy'"),
        ('ixx="0.03"', 'ixx="nan"', "upper.inertia.ixx: not a number"),
        ('xyz="0 1 0"', 'xyz="nan 0 0"', "shoulder.axis.xyz: not a number"),
        ('xyz="0 1 0"', 'xyz="0 0 0"', "shoulder.axis: an axis without a direction"),
        ('xyz="0 0 0.4"', 'xyz="0 nan 0.4"', "shoulder.origin.xyz: not a number"),
        ('xyz="0 0 0.4"', 'xyz="0 0.4"', "shoulder.origin.xyz: wrong count of numbers; expected 3"),
        ('lower="-2" upper="2"', 'lower="2" upper="-2"', "shoulder: limits are inverted"),
        ("<axis", '<mimic joint="knee"/><axis', "shoulder.mimic: no such joint to follow; got 'knee'; choices: elbow"),
        ("<axis", '<mimic joint="elbow" offset="x"/><axis', "shoulder.mimic.offset: not a number; got 'x'"),
        ('type="revolute"', 'type="planar"', "shoulder: a joint of an unknown type; got 'planar'; choices"),
        ('type="revolute"', 'type="revolut"', "did you mean 'revolute'"),
        ("</robot>", TWICE, "elbow: two joints of one name"),
        ("</robot>", '<link name="upper"/></robot>', "upper: two links of one name"),
        ('<child link="lower"/>', '<child link="gone"/>', "small.urdf"),
        ('<child link="lower"/>', '<child link="base"/>', "small.urdf"),
        ('<?xml version="1.0"?>', BOMB, "declares an entity"),
        ("<robot", "<robot>" * 300 + "<robot", "nested too deeply"),
    ],
)
def test_urdf(tmp_path, monkeypatch, old, new, said):
    refused("urdf", tmp_path, lambda text: text.replace(old, new, 1), said, monkeypatch)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('mass="2"', 'mass="inf"', "inertial.mass: is not finite"),
        ('mass="2"', 'mass="1e300"', "upper: implausible mass"),
        ('axis="0 1 0"', 'axis="nan 0 0"', "joint.axis: is not finite"),
        ('pos="0 0 0.4"', 'pos="0 nan 0.4"', "body.pos: is not finite"),
        ('range="-2 2"', 'range="2 -2"', "joint.range: limits are inverted"),
        ('name="elbow"', 'name="shoulder"', "repeated name 'shoulder'"),
        ('count="3"', 'count="1000000"', "too many elements; expected at most 20000, copies counted"),
        ('<replicate count="3"', '<replicate count="300"><replicate count="300"', "is not XML"),
        ('file="more.xml"', 'file="small.xml"', "include: .*small.xml: includes itself"),
        ('file="more.xml"', 'file="gone.xml"', "gone.xml: no such file"),
        ("<asset>", '<asset><texture name="t" type="2d" builtin="flat" width="200000" height="9"/>', "texture.width"),
        ("<mujoco", f"{BOMB}<mujoco", "declares an entity"),
        ("<mujoco", "<robot", "is not XML"),
    ],
)
def test_mjcf(tmp_path, monkeypatch, old, new, said):
    refused("xml", tmp_path, lambda text: text.replace(old, new, 1), said, monkeypatch)


@pytest.mark.parametrize("kind", WRITE)
@pytest.mark.parametrize(("code", "said"), [("utf-32", "is"), ("cp037", "is")])
def test_odd_encodings(tmp_path, monkeypatch, kind, code, said):
    refused(kind, tmp_path, lambda text: text.encode(code), said, monkeypatch)


def test_an_mjcf_in_latin_1_is_refused_and_a_urdf_that_says_so_is_read(tmp_path, monkeypatch):
    refused("xml", tmp_path, lambda text: text.replace("upper", "\xe9").encode("latin-1"), "UTF-8", monkeypatch)
    path = write_urdf(tmp_path)
    text = path.read_text().replace('"1.0"?', '"1.0" encoding="latin-1"?').replace("lower", "\xe9")
    path.write_bytes(text.encode("latin-1"))
    assert load(path).links[1] == "\xe9"


@pytest.mark.parametrize("kind", WRITE)
def test_pipes_in_place_of_files_do_not_hang(tmp_path, monkeypatch, kind):
    path = WRITE[kind](tmp_path)
    (tmp_path / "skin.stl").unlink()
    os.mkfifo(tmp_path / "skin.stl")
    model = load(path).compile()  # as if the mesh were missing
    assert model.nmesh == 0
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(UserError, match="no such robot file"):
        load(path)


def test_the_size_that_an_mjcf_asks_for_is_not_ours(tmp_path):
    path = write_mjcf(tmp_path)
    path.write_text(path.read_text().replace('memory="1M"', 'nuserdata="2000000000" nkey="200000000"'))
    model = load(path).compile()
    assert model.nuserdata == 0 and model.nkey == 0


@pytest.mark.parametrize("kind", WRITE)
def test_sliding_joints_are_held_and_said_to_be_where_an_arm_rides_on_one(tmp_path, kind):
    """A gripper's fingers change no motion of the arm; a linear axis does."""
    path = WRITE[kind](tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "[^:]*: the arm is without meshes")
        arm = load(path)
    assert arm.joints == ("shoulder", "elbow") and arm.flange == "flange"
    np.testing.assert_array_equal(arm.range, [[-2, 2], [-2, 2]])


def test_a_linear_axis_that_carries_the_arm_is_said_to_be_held(tmp_path):
    path = write_mjcf(tmp_path)
    path.write_text(
        path.read_text().replace('<joint name="shoulder"', '<joint name="rail" type="slide"/><joint name="shoulder"', 1)
    )
    with pytest.warns(UserWarning, match="sliding joints that carry others are fixed at their initial position: rail$"):
        assert load(path).joints == ("shoulder", "elbow")


def test_a_simulation_that_diverges_leaves_no_log(tmp_path, monkeypatch):
    import mujoco

    monkeypatch.chdir(tmp_path)
    model = load("iiwa14").compile()
    data = mujoco.MjData(model)
    data.qvel[0] = np.nan
    with pytest.warns(UserWarning, match="MuJoCo: "):
        mujoco.mj_step(model, data)
    assert not os.listdir(tmp_path)
