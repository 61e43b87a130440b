"""What no column of a recording is for: goals of no stated quantity, and measured signals of one's own."""

from pathlib import Path

import numpy as np
import pytest
from logged import DQ, JOINTS, TAU, TIME, N, Q, numbered, write_table
from typed import convert

from vispeg.recordings.load import load

CURRENT = np.sin(3 * TIME)[:, None] + np.arange(7)
WARM = 20 + np.cumsum(np.abs(DQ), axis=0) / N + np.arange(7)
POSE = (
    {"time": TIME} | numbered("pos_{}", Q, 1) | numbered("tau_{}", TAU, 1)
)  # a torque, so that no current becomes one


def converted(tmp_path: Path, columns, capsys):
    """The recording that is proposed, and what is said of it; the same comes from the saved map."""
    file = write_table(tmp_path / "log.csv", columns)
    assert convert(file, "iiwa14", tmp_path / "rig", guess=True, yes=True, save_map=tmp_path / "map.yaml") == 0
    assert convert(file, "iiwa14", tmp_path / "again", map=tmp_path / "map.yaml") == 0
    assert (tmp_path / "again" / "samples.csv").read_bytes() == (tmp_path / "rig" / "samples.csv").read_bytes()
    return load(tmp_path / "rig"), capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "unit", "per"),
    [("goal_{}", 1.0, 1.0), ("goal_{}", 180 / np.pi, 180 / np.pi), ("target_{}", 1.0, 1.0), ("setpoint_A{}", 1.0, 1.0)],
)
def test_goals_of_no_stated_quantity_are_angles_where_the_angles_follow(name, unit, per, tmp_path, capsys):
    columns = {"time": TIME} | numbered("pos_{}", unit * Q, 1) | numbered(name, per * (Q + 0.01), 1)
    rec, said = converted(tmp_path, columns, capsys)
    np.testing.assert_allclose(rec.q_cmd, Q + 0.01, atol=2e-3)
    assert rec.control.mode == "servo" and "which the angles follow" in said


def test_commands_of_no_stated_quantity_that_the_angles_do_not_follow_are_not_used(tmp_path, capsys):
    rec, said = converted(tmp_path, {"time": TIME} | numbered("pos_{}", Q, 1) | numbered("target_{}", TAU, 1), capsys)
    assert rec.q_cmd is None and rec.tau_cmd is None and not rec.signals
    assert "not used: target_1 (a command of no stated quantity, which the angles do not follow)" in said


def test_speeds_of_the_tool_are_not_those_of_the_joints(tmp_path, capsys):
    columns = numbered("pos_{}", Q, 1) | numbered("actual_TCP_speed_{}", CURRENT, 1)  # as many as the joints
    rec, said = converted(tmp_path, {"time": TIME} | columns | numbered("tau_{}", TAU, 1), capsys)
    assert rec.dq is None and not rec.signals
    assert "not used: actual_TCP_speed_1 (a pose, speed or force of the tool, not of a joint)" in said


@pytest.mark.parametrize(
    ("pattern", "first", "called", "unit"),
    [
        ("current_{}[mA]", 1, "current", "mA"),
        ("current_mA_{}", 0, "current", "mA"),
        ("current_{}_A", 1, "current", "A"),
        ("I_{} [A]", 0, "current", "A"),
        ("temperature_{} [degC]", 0, "temperature", "degC"),
        ("joint_temperatures_{}", 0, "temperature", "unknown"),
        ("Motor voltage {} (V)", 1, "voltage", "V"),
        ("humidity_{}[%]", 1, "humidity", "%"),
        ("brakeWear_{}", 1, "brake_wear", "unknown"),
        ("slip_{}_m_s", 1, "slip", "m/s"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*torque_sensor")
def test_what_comes_one_a_joint_and_is_of_no_known_quantity_is_a_signal_of_ones_own(
    pattern, first, called, unit, tmp_path, capsys
):
    rec, said = converted(tmp_path, POSE | numbered(pattern, CURRENT, first), capsys)
    assert {name: signal.unit for name, signal in rec.signals.items()} == {called: unit}
    np.testing.assert_allclose(rec.signals[called].values, CURRENT, atol=1e-6)
    doubt = f"look at: no name states the unit of {called}: write it in place of `unknown` under `signals`"
    assert (doubt in said) == (unit == "unknown")


@pytest.mark.filterwarnings("ignore:.*torque_sensor")
@pytest.mark.parametrize("names", [JOINTS, [f"joint{j}" for j in range(7)]], ids=["names", "numbers from 0"])
def test_two_signals_of_ones_own_by_the_joints_names_in_any_order(names, tmp_path, capsys):
    columns = {"time": TIME} | {f"{joint}_pos": Q[:, j] for j, joint in enumerate(names)}
    columns |= {f"{joint}_tau_Nm": TAU[:, j] for j, joint in enumerate(names)}
    columns |= {f"{names[j]}_current[mA]": CURRENT[:, j] for j in reversed(range(7))}
    columns |= {f"temp.{names[j]}": WARM[:, j] for j in (2, 0, 1, 3, 6, 5, 4)}
    rec, _ = converted(tmp_path, columns, capsys)
    np.testing.assert_allclose(rec.signals["current"].values, CURRENT, atol=1e-6)
    np.testing.assert_allclose(rec.signals["temperature"].values, WARM, atol=1e-6)


@pytest.mark.filterwarnings("ignore:.*torque_sensor")
@pytest.mark.parametrize(
    "columns",
    [
        numbered("tau_ext_{}", TAU, 1) | numbered("ddq_{}", TAU, 1),  # known quantities, of which nothing is used
        numbered("theta_{}", Q + 3, 1),  # known angles beside those that are taken
        {f"current_{k}": CURRENT[:, k] for k in range(1, 6)},  # not one a joint
        numbered("current_{}", CURRENT, 4),  # numbers of no joints
        numbered("actual_TCP_pose_{}", CURRENT) | numbered("wrench_{}", CURRENT),  # numbered, but not by joints
        numbered("output_double_register_{}", CURRENT),  # free memory of a controller
        numbered("mode_{}", np.ones_like(Q), 1),  # never changes
        numbered("temp_{}[C]", CURRENT) | {"temp_3[K]": CURRENT[:, 3]},  # twice a joint
        {f"temp_{k}[{'CK'[k > 3]}]": CURRENT[:, k] for k in range(7)},  # in two units
        numbered("load_{}", TAU, 1),  # a torque
    ],
)
def test_what_is_known_or_not_one_a_joint_is_no_signal_of_ones_own(columns, tmp_path, capsys):
    rec, said = converted(tmp_path, POSE | columns, capsys)
    assert not rec.signals and "signals" not in said


def test_currents_that_become_torques_are_no_signal_beside(tmp_path, capsys):
    file = write_table(tmp_path / "log.csv", {"time": TIME} | numbered("pos_{}", Q) | numbered("current_{}[A]", TAU))
    constants = ["2", "2", "2", "2", "2", "2", "2"]
    assert convert(file, "iiwa14", tmp_path / "rig", guess=True, yes=True, torque_constants=constants) == 0
    rec = load(tmp_path / "rig")
    np.testing.assert_allclose(rec.tau, 2 * TAU, atol=1e-6)
    assert not rec.signals
