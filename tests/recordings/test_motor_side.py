"""Logs of motors: joints turn by a part of them, or by several, and power is the same on both sides."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import yaml
from test_logs_of_people import ARM, DQ, JOINTS, TAU, TIME, Q, numbered, table, taken

from vispeg.api.recording.convert import convert
from vispeg.api.recording.guess import propose
from vispeg.core.errors import UserError

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
WRISTS = {
    "elbow_joint": {"elbow_joint": 0.5, "roll_joint": 0.5},
    "roll_joint": {"elbow_joint": -1.5, "roll_joint": 2.0},
}


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    return str(tmp_path / "arm.xml")


def motors(turn):
    """Angles, speeds and torques (n, 4) of the motors of `q = turn m`, with the power of the joints."""
    back = np.linalg.inv(turn)
    return Q @ back.T, DQ @ back.T, TAU @ turn


def converted(tmp_path, arm, columns, sections, name="rig", **keys):
    """The recording of columns q, dq and tau (n, 4), with further sections of the map."""
    file = {"time": TIME} | {k: v for word, values in columns.items() for k, v in numbered(word, values).items()}
    lines = {f"{word}.{joint}": f"{word}_{j}" for word in columns for j, joint in enumerate(JOINTS)}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({"time": "time", **lines, **sections}))
    return convert(
        table(tmp_path / "log.csv", file),
        arm,
        tmp_path / name,
        mapping=tmp_path / "map.yaml",
        torque_sensor="motor",
        **keys,
    )


def matrix(section):
    out = np.eye(4)
    for joint, terms in section.items():
        terms = terms if isinstance(terms, dict) else {joint: float(Fraction(str(terms)))}
        out[JOINTS.index(joint)] = [terms.get(name, 0.0) for name in JOINTS]
    return out


@pytest.mark.parametrize("section", [dict.fromkeys(JOINTS, 0.01), {"lift_joint": "-1/8"}, WRISTS], ids=str)
def test_motors_become_joints_and_the_power_is_the_same(section, tmp_path, arm):
    q, dq, tau = motors(matrix(section))
    rec = converted(tmp_path, arm, {"q": q, "dq": dq, "tau": tau}, {"motors": section})
    np.testing.assert_allclose(rec.q, Q, atol=1e-9)
    np.testing.assert_allclose(rec.dq, DQ, atol=1e-9)
    np.testing.assert_allclose(rec.tau, TAU, atol=1e-9)
    np.testing.assert_allclose(np.sum(rec.tau * rec.dq, axis=1), np.sum(tau * dq, axis=1), atol=1e-9)


def test_a_reading_that_is_missing_counts_for_its_own_joints_alone(tmp_path, arm):
    q, dq, tau = motors(matrix(WRISTS))
    q[100, 2] = tau[200, 3] = np.nan
    rec = converted(tmp_path, arm, {"q": q, "dq": dq, "tau": tau}, {"motors": WRISTS})
    assert np.isnan(rec.q[100]).tolist() == [False, False, True, True]
    assert np.isnan(rec.tau[200]).tolist() == [False, False, True, True]


def test_a_command_on_the_other_side_of_a_motors_wrap_is_near_the_angle(tmp_path, arm):
    """Both begin within a turn; the command is 0.016 rad of the motor behind."""
    q, dq, tau = motors(matrix({"lift_joint": 0.125}))
    q[:, 1] += 0.01 - q[0, 1]
    behind = (q - 0.016) % (2 * np.pi)
    q[:, 1] %= 2 * np.pi
    assert behind[0, 1] - q[0, 1] > 6
    rec = converted(tmp_path, arm, {"q": q, "q_cmd": behind, "dq": dq}, {"motors": {"lift_joint": 0.125}})
    np.testing.assert_allclose(rec.q[:, 1] - rec.q_cmd[:, 1], 0.002, atol=1e-9)


def test_a_motors_angle_wraps_at_its_own_turn(tmp_path, arm):
    q, dq, tau = motors(matrix({"lift_joint": 0.125}))
    q[:, 1] = (q[:, 1] + np.pi) % (2 * np.pi) - np.pi
    rec = converted(tmp_path, arm, {"q": q, "dq": dq, "tau": tau}, {"motors": {"lift_joint": 0.125}})
    turns = (rec.q[:, 1] - Q[:, 1]) / (2 * np.pi / 8)  # which turn it began in, no reading says
    np.testing.assert_allclose(turns, round(turns[0]), atol=1e-9)


def test_terms_add_up_in_one_column_of_the_map(tmp_path, arm):
    """As `plus` says: angles alone, one joint of three columns in units of their own."""
    parts = [0.2 * Q[:, 1], np.degrees(0.5 * Q[:, 1]), -0.3 * Q[:, 1]]
    file = table(tmp_path / "log.csv", {"time": TIME} | numbered("q", Q) | {f"m{k}": v for k, v in enumerate(parts)})
    terms = [{"column": "m1", "unit": "deg"}, {"column": "m2", "scale": -1, "offset": 0.05}]
    lines = {f"q.{joint}": f"q_{j}" for j, joint in enumerate(JOINTS)} | {
        "q.lift_joint": {"column": "m0", "plus": terms}
    }
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({"time": "time", **lines}))
    rec = convert(file, arm, tmp_path / "rig", mapping=tmp_path / "map.yaml")
    np.testing.assert_allclose(rec.q, Q + [0, 0.05, 0, 0], atol=1e-9)


def test_an_archive_of_motors(tmp_path, arm):
    """Whole arrays, whose joints have no column of their own."""
    q, dq, tau = motors(matrix(WRISTS))
    np.savez(tmp_path / "log.npz", time=TIME, q=q, dq=dq, tau=tau)
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({"motors": WRISTS}))
    rec = convert(tmp_path / "log.npz", arm, tmp_path / "rig", mapping=tmp_path / "map.yaml", torque_sensor="motor")
    np.testing.assert_allclose(rec.q, Q, atol=1e-9)
    np.testing.assert_allclose(rec.tau, TAU, atol=1e-9)


@pytest.mark.parametrize("section", [{"lift_joint": "1/8"}, WRISTS], ids=str)
def test_a_constant_is_the_joints_or_the_motors(section, tmp_path, arm):
    """A constant at the joint gives the joint's torque without `motors`; the motor's own is a scale, and the gear's."""
    q, dq, tau = motors(matrix(section))
    current = {"time": TIME} | numbered("q", q) | numbered("i", tau / 0.25)
    lines = {f"q.{joint}": f"q_{j}" for j, joint in enumerate(JOINTS)} | {"motors": section}
    file = table(tmp_path / "log.csv", current)
    for stated in ({"unit": "A", "torque_constant": 0.25}, {"scale": 0.25}):
        lines |= {f"tau.{joint}": {"column": f"i_{j}", **stated} for j, joint in enumerate(JOINTS)}
        (tmp_path / "map.yaml").write_text(yaml.safe_dump({"time": "time", **lines}))
        if "unit" in stated:
            with pytest.raises(UserError, match="`motors` would convert a constant at the joint again"):
                convert(file, arm, tmp_path / "rig", mapping=tmp_path / "map.yaml")
    rec = convert(file, arm, tmp_path / "rig", mapping=tmp_path / "map.yaml", torque_sensor="motor")
    np.testing.assert_allclose(rec.tau, TAU, atol=1e-9)


def test_a_constant_of_a_joint_beside_motors_of_another(tmp_path, arm):
    q, _, tau = motors(matrix({"lift_joint": 0.125}))
    tau[:, 0] = TAU[:, 0] / 10.0
    lines = {f"{word}.{joint}": f"{word}_{j}" for word in ("q", "tau") for j, joint in enumerate(JOINTS)}
    lines["tau.base_joint"] = {"column": "tau_0", "unit": "A", "torque_constant": 10.0}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({"time": "time", **lines, "motors": {"lift_joint": 0.125}}))
    file = table(tmp_path / "log.csv", {"time": TIME} | numbered("q", q) | numbered("tau", tau))
    rec = convert(file, arm, tmp_path / "rig", mapping=tmp_path / "map.yaml", torque_sensor="motor")
    np.testing.assert_allclose(rec.tau, TAU, atol=1e-9)


def test_the_refusal_of_a_range_names_motors(tmp_path, arm):
    with pytest.raises(UserError, match="motors: in a map if angles are the motors'"):
        converted(tmp_path, arm, {"q": 8 * Q}, {})


BAD = {
    "same": ({"elbow_joint": {"lift_joint": 2.0}, "lift_joint": {"lift_joint": 1.0}}, "the matrix is singular"),
    "zero": ({"lift_joint": 0}, "is no ratio; expected joint angle over motor angle"),
    "text": ({"lift_joint": "eight"}, "is no ratio"),
    "fraction": ({"lift_joint": "1/2/3"}, "is no ratio"),
    "joint": ({"foot": 0.5}, "no such joint; got 'foot'"),
    "motor": ({"lift_joint": {"foot": 0.5}}, "no such joint; got 'foot'"),
    "nothing": ({"lift_joint": {}}, "names no motor"),
    "list": ([0.125], "motors: is not a mapping"),
}


@pytest.mark.parametrize("case", BAD)
def test_motors_that_cannot_be_are_refused(case, tmp_path, arm):
    section, words = BAD[case]
    with pytest.raises(UserError, match=words):
        converted(tmp_path, arm, {"q": Q, "tau": TAU}, {"motors": section})
    assert not (tmp_path / "rig").exists()


GIVEN = TAU + 0.5 * np.tanh(50 * DQ)
GEAR = dict.fromkeys(JOINTS, "1/8")


def of_gear(gear, tau=GIVEN):
    """Columns of motors that turn `gear` times as far as their joints."""
    return numbered("q", Q * gear) | numbered("dq", DQ * gear) | numbered("tau", tau / gear)


@pytest.mark.parametrize("unit", ["", "_rad", "_deg"])
def test_a_gear_of_eight_is_proposed_where_the_torques_tell_it(unit, tmp_path, arm):
    columns = of_gear(8.0)
    if unit:
        factor = np.degrees(1) if unit == "_deg" else 1.0
        columns = {f"{k}{unit if k[0] == 'q' else ''}": v * (factor if k[0] in "qd" else 1) for k, v in columns.items()}
    rec, guessed = taken(
        table(tmp_path / "log.csv", {"time": TIME} | columns), arm, tmp_path / "rig", torque_sensor="motor"
    )
    assert guessed.record["motors"] == GEAR
    np.testing.assert_allclose(rec.q, Q, atol=1e-9)
    np.testing.assert_allclose(rec.dq, DQ, atol=1e-9)
    np.testing.assert_allclose(rec.tau, GIVEN, atol=1e-9)
    np.testing.assert_allclose(np.sum(rec.tau * rec.dq, axis=1), np.sum(GIVEN * DQ, axis=1), atol=1e-9)


def test_torques_behind_the_gear_stay_where_angles_are_the_motors(tmp_path, arm):
    columns = of_gear(8.0) | numbered("tau", GIVEN)
    rec, guessed = taken(
        table(tmp_path / "log.csv", {"time": TIME} | columns), arm, tmp_path / "rig", torque_sensor="joint"
    )
    assert "motors" not in guessed.record and "its motor's side: 1/8" in str(guessed)
    np.testing.assert_allclose(rec.q, Q, atol=1e-9)
    np.testing.assert_allclose(rec.dq, DQ, atol=1e-9)
    np.testing.assert_allclose(rec.tau, GIVEN, atol=1e-9)


def test_degrees_are_no_motors(tmp_path, arm):
    columns = numbered("q", np.degrees(Q)) | numbered("tau", GIVEN)
    guessed = propose(table(tmp_path / "log.csv", {"time": TIME} | columns), arm, "motor")
    assert guessed.record["q.lift_joint"]["unit"] == "deg" and "motor" not in str(guessed).replace("sensor: motor", "")


def test_a_ratio_that_nothing_tells_is_asked_for(tmp_path, arm):
    """Without torque, or where the torques are another motion's."""
    bare = {"time": TIME} | numbered("q_rad", Q * 8)
    strange = bare | numbered("tau", np.random.default_rng(5).normal(size=Q.shape))
    for columns in (bare, strange):
        guessed = propose(table(tmp_path / "log.csv", columns), arm)
        assert "motors" not in guessed.record
        assert "base_joint -7.2 to 7.2 rad for a range of -3.1 to 3.1" in str(guessed)
        assert "state `motors: {base_joint: 1/GEAR, ..}` in the map" in str(guessed)
    small = propose(table(tmp_path / "small.csv", {"time": TIME} | numbered("q", Q * 8)), arm)
    assert "small angles in degrees, or the motors' in radians" in str(small)


def test_two_gears_in_one_arm_are_told_apart(tmp_path, arm):
    gear = np.array([1.0, 8.0, 30.0, 1.0])
    rec, guessed = taken(
        table(tmp_path / "log.csv", {"time": TIME} | of_gear(gear)), arm, tmp_path / "rig", torque_sensor="motor"
    )
    assert guessed.record["motors"] == {"lift_joint": "1/8", "elbow_joint": "1/30"}
    np.testing.assert_allclose(rec.q, Q, atol=1e-9)
    np.testing.assert_allclose(rec.tau, GIVEN, atol=1e-9)


RPM = 30 / np.pi
SPLIT = {"sec": np.floor(TIME), "nsec": np.round(1e9 * (TIME % 1.0))}
KUKA = {"ZeitSec": SPLIT["sec"], "ZeitNanoSec": SPLIT["nsec"]}


@pytest.mark.parametrize(
    ("clock", "angle", "speed", "gear"),
    [
        ({"time": TIME}, ("deg", np.degrees(1)), ("rpm", RPM), 8.0),
        ({"time": TIME}, ("deg", np.degrees(1)), ("rad/s", 1.0), 8.0),
        ({"time": TIME}, ("rad", 1.0), ("rpm", RPM), 1.0),
        (SPLIT, ("rad", 1.0), ("rad/s", 1.0), 1.0),
        (KUKA, ("rad", 1.0), ("rad/s", 1.0), 1.0),
    ],
    ids=["motor deg, rpm", "motor deg, rad/s", "joint rpm", "joint, split time", "time split as by KUKA"],
)
def test_a_speed_is_told_to_be_the_motors_or_the_joints_in_any_unit(clock, angle, speed, gear, tmp_path, arm):
    """Angles of motors with a gear of eight; speeds of the motors or of the joints."""
    columns = {f"q_{j} [{angle[0]}]": Q[:, j] * 8.0 * angle[1] for j in range(4)}
    columns |= {f"dq_{j} [{speed[0]}]": DQ[:, j] * gear * speed[1] for j in range(4)}
    file = table(tmp_path / "log.csv", clock | columns | numbered("tau", GIVEN / 8.0))
    rec, _ = taken(file, arm, tmp_path / "rig", torque_sensor="motor")
    np.testing.assert_allclose(rec.q, Q, atol=1e-5)
    np.testing.assert_allclose(rec.dq, DQ, atol=1e-5)
    np.testing.assert_allclose(rec.time, TIME, atol=1e-9)
