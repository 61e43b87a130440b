"""Motor currents become torques by torque constants: stated, published, or asked for."""

from __future__ import annotations

import numpy as np
import pytest
from test_logs_of_people import ARM, DQ, JOINTS, TAU, TIME, N, Q, numbered, table, taken

from vispeg.api.recording.convert import convert
from vispeg.api.recording.guess import propose
from vispeg.core.errors import UserError
from vispeg.recordings.importers.guess.constants import of_arm, published, stated

UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint")
GIVEN = TAU + 1.5 * np.tanh(50 * DQ)  # what the motors give: the arm's torque and friction
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    return str(tmp_path / "arm.xml")


@pytest.fixture
def ur5e(tmp_path):
    text = ARM.replace('model="four"', 'model="ur5e_robot"')
    for ours, theirs in zip(JOINTS, UR, strict=True):
        text = text.replace(f'"{ours}"', f'"{theirs}"')
    (tmp_path / "robot.xml").write_text(text)
    return str(tmp_path / "robot.xml")


def constants(joints=UR):
    return np.array([of_arm("ur5e", joints)[joint].value for joint in joints])


def log(tmp_path, name, values, q=Q):
    return table(tmp_path / "log.csv", {"time": TIME} | numbered("actual_q", q) | numbered(name, values))


def bracketed(tmp_path, unit, values):
    """Columns such as `I_0 [mA]`."""
    currents = {f"I_{k} [{unit}]": values[:, k] for k in range(4)}
    return table(tmp_path / "log.csv", {"time": TIME} | numbered("actual_q", Q) | currents)


@pytest.mark.parametrize(("name", "per"), [("actual_current", 1.0), ("effort", 1.0), ("effort", 1e3)])
def test_the_constants_of_a_known_arm_make_its_currents_torques(name, per, tmp_path, ur5e):
    """Whether they are called so or not, in A or mA, and at a joint whose sign is turned."""
    signs = np.array([1, -1, 1, 1])
    rec, guessed = taken(log(tmp_path, name, per * signs * GIVEN / constants()), ur5e, tmp_path / "rig")
    np.testing.assert_allclose(rec.tau, GIVEN, atol=1e-9)
    assert rec.torque_sensor == "motor"
    said = str(guessed)
    unit = "A" if per == 1 else "mA"
    assert f"unit: {unit}, scale: -1.0, torque_constant: 10.15}}" in said and "aurt/globals.py" in said
    beside = next(line for line in guessed.proposal.doubts if "this motion and the model's masses" in line)
    for joint, k in zip(UR, constants(), strict=True):
        own = float(beside.partition(f"{joint} ")[2].split()[0])
        assert abs(own) == pytest.approx(k, rel=0.02), joint


def test_a_torque_of_a_known_arm_is_no_current(tmp_path, ur5e):
    rec, guessed = taken(log(tmp_path, "effort", GIVEN), ur5e, tmp_path / "rig", torque_sensor="motor")
    np.testing.assert_allclose(rec.tau, GIVEN, atol=1e-9)
    assert "torque_constant" not in str(guessed)


@pytest.mark.parametrize(("unit", "per"), [("A", 1.0), ("mA", 1e3)])
def test_stated_constants_count_with_the_unit_of_the_header(unit, per, tmp_path, arm):
    k = np.array([3.0, 5.0, 2.0, 1.5])
    file = bracketed(tmp_path, unit, per * GIVEN / k)
    rec, guessed = taken(file, arm, tmp_path / "rig", torque_constants=[str(x) for x in k])
    np.testing.assert_allclose(rec.tau, GIVEN, atol=1e-9)
    assert f"the name says {unit}" in str(guessed) and "stated" in str(guessed)
    one, _ = taken(file, arm, tmp_path / "one", torque_constants=["lift_joint=5"])
    np.testing.assert_allclose(one.tau[:, 1], GIVEN[:, 1], atol=1e-9)
    assert np.isnan(one.tau[:, [0, 2, 3]]).all()


def test_constants_count_where_the_motion_tells_no_scale(tmp_path, arm):
    """An arm at rest: without constants there is no torque, and they are asked for."""
    still, held = np.tile(Q[100], (N, 1)), np.tile(GIVEN[100], (N, 1))
    still, held = (v + 1e-4 * np.random.default_rng(k).normal(size=v.shape) for k, v in enumerate((still, held)))
    file = log(tmp_path, "current", held / 2.0, still)
    asked = propose(file, arm)
    assert "tau" not in asked.proposal.signals() and "--torque-constants" in str(asked)
    rec, guessed = taken(file, arm, tmp_path / "rig", torque_constants=["2", "2", "2", "2"])
    np.testing.assert_allclose(rec.tau, held, atol=1e-9)
    assert "A is taken" in str(guessed)


def test_without_constants_the_scale_is_the_models_and_they_are_asked_for(tmp_path, arm):
    rec, guessed = taken(log(tmp_path, "current", GIVEN / 12.0), arm, tmp_path / "rig")
    assert np.polyfit(GIVEN[:, 1], rec.tau[:, 1], 1)[0] == pytest.approx(1, abs=0.05)
    assert "without the use of the model's masses: --torque-constants" in str(guessed)


def test_constants_that_do_not_fit_the_motion_are_said(tmp_path, arm):
    guessed = propose(bracketed(tmp_path, "A", GIVEN / 12.0), arm, torque_constants=["XM540-W270"])
    assert "they do not agree, look at unit and constants" in str(guessed)
    assert "at stall, 10.6 N m at 4.4 A and 12 V: emanual.robotis.com" in str(guessed)


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (["1", "2"], "not a number a joint; expected 4 numbers"),
        (["XM999"], "not known; expected N m/A at the joint.*choices: ur5e"),
        (["0", "1", "1", "1"], "no torque constant; expected 0.0001"),
        (["foot=1"], "is no joint of the robot"),
        (["lift_joint=1", "lift_joint=2"], "is stated twice"),
    ],
)
def test_constants_that_cannot_be_are_refused(texts, words, tmp_path, arm):
    with pytest.raises(UserError, match=words):
        propose(log(tmp_path, "current", GIVEN), arm, torque_constants=texts)


def test_constants_beside_a_torque_or_nothing_are_refused(tmp_path, arm):
    named = table(tmp_path / "log.csv", {"time": TIME} | numbered("q", Q) | numbered("torque_Nm", TAU))
    with pytest.raises(UserError, match="the name says that it is no current"):
        propose(named, arm, torque_constants=["1", "1", "1", "1"])
    with pytest.raises(UserError, match="no column looks like a current"):
        propose(table(tmp_path / "log.csv", {"time": TIME} | numbered("q", Q)), arm, torque_constants=["XM430-W350"])


MAPS = {
    "tau.lift_joint: {column: i, unit: A}": "a current needs its torque constant; expected torque_constant: N m/A",
    "tau.lift_joint: {column: i, unit: A, torque_constant: -3}": "no torque constant; expected above 0",
    "tau.lift_joint: {column: i, unit: A, torque_constant: x}": "torque_constant: is not a number",
    "tau.lift_joint: {column: i, unit: N m, torque_constant: 3}": "has a torque constant but no current",
    "q.lift_joint: {column: i, unit: A, torque_constant: 3}": "a current is no reading of this",
}


@pytest.mark.parametrize("text", MAPS)
def test_a_map_states_current_and_constant_together(text, tmp_path, arm):
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(UserError, match=MAPS[text]):
        convert(log(tmp_path, "current", GIVEN), arm, tmp_path / "rig", mapping=tmp_path / "map.yaml")
    assert not (tmp_path / "rig").exists()


def test_a_table_takes_constants_by_its_map_alone(tmp_path, arm):
    with pytest.raises(
        UserError, match="are not used with this source; expected guess, a bag, or torque_constant in the map"
    ):
        convert(log(tmp_path, "current", GIVEN), arm, tmp_path / "rig", torque_constants=["XM430-W350"])


def test_an_arm_with_torque_sensors_says_so(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM.replace('model="four"', 'model="panda"'))
    guessed = propose(log(tmp_path, "effort", TAU), str(tmp_path / "arm.xml"))
    assert guessed.record["recording"] == {"torque_sensor": "joint"} and "libfranka" in str(guessed)


def test_each_published_figure_has_its_source():
    data = published()
    assert all(entry["source"] for kind in data.values() for entry in kind.values())
    assert stated(["XM430-W350"], ["a"])["a"].value == pytest.approx(4.1 / 2.3, rel=1e-3)
    assert list(stated(["ur5e"], [*"abcdef"])) == [*"abcdef"]
    assert not of_arm("ur5e_wrong ur50", ["x"]) and not of_arm("my-ur5", ["x"])
