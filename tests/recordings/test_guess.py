"""Headers as robots and tools write them: the whole map is proposed, and converting with it gives the motion back."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from logged import DQ, JOINTS, STYLES, TAU, TIME, TRUTH, N, Q, numbered, write_table
from typed import convert

from vispeg.core.errors import UserError
from vispeg.core.notes import Note
from vispeg.recordings.importers.guess.names import meaning
from vispeg.recordings.importers.guess.propose import Proposal, joint_columns, own_names
from vispeg.recordings.load import load
from vispeg.recordings.tables.table import Dialect, Table

SHARED = Path(os.environ.get("VISPEG_SHARED", Path(__file__).resolve().parents[3] / "shared"))


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.filterwarnings("ignore:.*torque_sensor")
def test_a_whole_map_is_proposed(tmp_path, style, capsys):
    columns, signals = STYLES[style]
    german = style == "german"
    file = write_table(tmp_path / ("log.csv.gz" if german else "log.csv"), columns, *((";", ",") if german else ()))
    assert convert(file, "iiwa14", tmp_path / "rig", guess=True, yes=True, save_map=tmp_path / "map.yaml") == 0
    said = capsys.readouterr().out
    rec = load(tmp_path / "rig")
    assert np.allclose(rec.time - rec.time[0], TIME, atol=1e-6) and rec.joints == JOINTS
    for name in ("q", "dq", "tau", "tau_cmd", "q_cmd", "dq_cmd"):
        values = getattr(rec, name)
        assert (values is not None) == (name in signals), name
        if values is not None:
            assert np.allclose(values, TRUTH[name], atol=2e-3), name
    for line in (tmp_path / "map.yaml").read_text().splitlines():
        assert line in said and (line.startswith(("#", "recording:", "table:")) or "  # " in line), line
    assert convert(file, "iiwa14", tmp_path / "again", map=tmp_path / "map.yaml") == 0  # what is saved is what is used
    assert (tmp_path / "again" / "samples.csv").read_bytes() == (tmp_path / "rig" / "samples.csv").read_bytes()


def test_what_is_not_used_and_what_more_knowledge_buys_is_said(tmp_path, capsys):
    file = write_table(tmp_path / "log.csv", STYLES["franka"][0] | {"note": ["ok"] * N})
    assert convert(file, "iiwa14", guess=True) == 0
    said = capsys.readouterr().out
    assert "not used: tau_ext_hat_filtered_0 (an estimate of external torque" in said
    assert "torque_sensor: joint is guessed" in said and "inverse dynamics" in said
    assert "control: {mode: position" in said and "7 numbers, N m/rad" in said and "delays, gear play" in said
    assert [p.name for p in tmp_path.iterdir()] == ["log.csv"]


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        *((name, "time", "s") for name in ("seconds", "Sec", "secs", "t_s", "Time (s)", "time[s]_robot")),
        *((name, "time", unit) for name, unit in (("ms", "ms"), ("nanoseconds", "ns"))),
        *((name, "tau", "N m") for name in ("M1 [N·m]", "M1 [N-m]", "torque_1 (N m)")),
        *((name, quantity, "") for name, quantity in (("q_s_1", "q"), ("motor_1_torque_s_2", "tau"), ("J1_s2", ""))),
        ("s", "", "s"),
        ("tcp_speed [m/s]", "tool", "m/s"),
        *((name, "", "m/s") for name in ("m_s", "ee_v_m_s")),
        ("x_mm_s", "", "mm/s"),
        ("tau_n_m", "tau", "N m"),
        *((name, "dq", "") for name in ("q_dot_1", "thetaDot1", "joint1.q.dot")),
        *((name, "acceleration", "") for name in ("q_ddot_1", "theta_dot_dot_1", "dq_dot_1")),
        ("tau_dot_1", "jerk", ""),
        *((name, "share", "%") for name in ("torque_1 [%]", "A1 load (%)", "speed_percent_2")),
        ("%time", "time", ""),
    ],
)
def test_units_in_names(name, quantity, unit):
    found = meaning(name, {})
    assert (found.quantity, found.unit) == (quantity, unit)


@pytest.mark.parametrize(("name", "commanded"), [("AIPos_A1", False), ("ASPos.A1", True)])
def test_words_of_kuka_state_whether_angles_are_measured(name, commanded):
    found = meaning(name, {})
    assert (found.quantity, found.commanded) == ("q", commanded)


def placed(pattern, count, joints=JOINTS):
    """Return joint -> column of `count` angles whose columns are called by `pattern`, from 0."""
    out = Proposal(Path("log.csv"), [], [], {}, Dialect())
    table = Table(out.file, {}, [], 0, range(0))
    group = own_names([meaning(pattern.format(k), {}) for k in range(count)], joints, table)
    found = joint_columns(group, joints, "q", out)
    return {joint: m.name for joint, m in found.items()}


@pytest.mark.parametrize("pattern", ["joint_{}_pos", "joint{}", "Joint {} [rad]"])
def test_columns_counted_from_0_are_the_joints_in_their_order_even_if_those_are_counted_from_1(pattern):
    every = {joint: pattern.format(k) for k, joint in enumerate(JOINTS)}
    assert placed(pattern, 7) == every
    assert placed(pattern, 6) == {joint: every[joint] for joint in JOINTS[:6]}
    assert placed(pattern, 8) == {joint: pattern.format(k) for k, joint in enumerate(JOINTS, 1)}


def test_columns_that_are_called_as_one_joint_are_told():
    """Angles of the motors and behind an elastic gear, say, or those of two arms."""
    out = Proposal(Path("log.csv"), [], [], {}, Dialect())
    names = [f"{side}_{joint}_pos" for side in ("motor", "link") for joint in JOINTS]
    found = joint_columns([meaning(name, {}) for name in [*names, "tool_pos"]], JOINTS, "q", out)
    assert [m.name for m in found.values()] == names[:7]
    assert out.unused["link_joint2_pos"] == "motor_joint2_pos is taken for the measured angle"
    assert out.unused["tool_pos"] == "of no joint of this robot"
    assert "motor_joint1_pos and its like, not link_joint1_pos" in " ".join(out.doubts)


def test_a_column_called_seconds_is_the_time(tmp_path):
    columns = {"Seconds": TIME, **numbered("q_{}", Q)}
    assert convert(write_table(tmp_path / "log.csv", columns), "iiwa14", tmp_path / "rig", guess=True, yes=True) == 0
    assert np.allclose(load(tmp_path / "rig").time, TIME - TIME[0], atol=1e-6)


def test_a_guess_is_confirmed_or_nothing_is_written(tmp_path, monkeypatch, capsys):
    file = write_table(tmp_path / "log.csv", STYLES["plotjuggler"][0])
    with pytest.raises(UserError, match="must be confirmed.*yes.*save_map"):
        convert(file, "iiwa14", tmp_path / "rig", guess=True)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    for answer, there in (("", False), ("n", False), ("y", True)):
        monkeypatch.setattr("builtins.input", lambda _, answer=answer: answer)
        assert convert(file, "iiwa14", tmp_path / "rig", guess=True) == 0
        assert (tmp_path / "rig").exists() == there, answer
    with pytest.raises(UserError, match="map is given already"):
        convert(file, "iiwa14", guess=True, map=tmp_path / "m.yaml")


def test_a_joint_whose_columns_are_empty_is_held_and_the_torques_of_the_others_stay(tmp_path, capsys):
    """joint7 has no angle, joint6 no torque; and no warning of NumPy about empty columns is shown."""
    columns = {"time": TIME} | numbered("q_{}", Q, 1) | numbered("tau_{}", TAU, 1)
    columns["q_7"] = columns["tau_6"] = [""] * N
    file = write_table(tmp_path / "log.csv", columns)
    with pytest.warns(UserWarning, match="lacks 1 of the robot's joints") as warned:
        assert convert(file, "iiwa14", tmp_path / "rig", guess=True, yes=True, torque_sensor="joint") == 0
    assert all(issubclass(w.category, Note) for w in warned)
    said, rec = capsys.readouterr().out, load(tmp_path / "rig")
    assert "tau.joint6: none" in said and "not used: q_7 (no readings)" in said
    assert "not used: tau_7 (its joint has no measured angle)" in said
    assert rec.joints == JOINTS[:6] and np.isnan(rec.tau[:, 5]).all()
    assert np.allclose(rec.q, Q[:, :6]) and np.allclose(rec.tau[:, :5], TAU[:, :5])


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_one_infinite_angle_is_named_and_changes_no_unit(tmp_path, capsys):
    columns = {"time": TIME} | numbered("q_{}", Q, 1)
    columns["q_2"] = np.where(np.arange(N) == 7, np.inf, Q[:, 1])
    file = write_table(tmp_path / "log.csv", columns)
    assert convert(file, "iiwa14", guess=True) == 0
    said = capsys.readouterr().out
    assert "q.joint2: {column: q_2, unit: rad}" in said and "row 9, column q_2 (q.joint2): is infinite" in said
    first = write_table(tmp_path / "first.csv", {name: values[:1] for name, values in columns.items()})
    with pytest.raises(UserError, match="holds a single sample"):
        convert(first, "iiwa14", guess=True)


def test_doubts_are_said(tmp_path, capsys):
    names = ("Rotation", "Pitch", "Elbow", "Wrist", "Roll", "Jaw", "Grip")
    columns = {"t": TIME} | {f"goal_rad_{n}": Q[:, k] for k, n in enumerate(names)}
    columns |= {f"angle_rad_{n}": Q[:, k] for k, n in enumerate(names)}
    columns |= {f"load_nm_{n}": np.abs(TAU[:, k]) for k, n in enumerate(names)}
    assert convert(write_table(tmp_path / "log.csv", columns), "iiwa14", guess=True) == 0
    said = capsys.readouterr().out
    assert "q_cmd.joint3: {column: goal_rad_Elbow, unit: rad}" in said and "elbow is joint3" in said
    assert "torque_sensor: " not in said and "load_nm_Jaw (never negative" in said
    assert "recording: {control: {mode: servo}}" in said and "goals drive each joint's own loop" in said
    own = (
        {"time": TIME}
        | {f"q.{j}": Q[:, k] for k, j in enumerate(JOINTS)}
        | {f"tau.{j}": TAU[:, k] for k, j in enumerate(JOINTS)}
    )
    assert convert(write_table(tmp_path / "own.csv", own), "iiwa14", guess=True) == 0
    assert "no name states where torque was measured" in capsys.readouterr().out
    fewer = {name: values for name, values in STYLES["universal robots"][0].items() if not name.endswith("_6")}
    assert convert(write_table(tmp_path / "six.csv", fewer), "iiwa14", guess=True) == 0
    assert "the robot has 7 joints, the file 6: held at rest" in capsys.readouterr().out


def test_a_lerobot_table_of_lists(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    folder = tmp_path / "data" / "chunk-000"
    folder.mkdir(parents=True)
    lists = {"observation.state": np.degrees(Q), "action": np.degrees(Q + 0.01)}
    table = {k: pa.FixedSizeListArray.from_arrays(v.astype(np.float32).ravel(), 7) for k, v in lists.items()}
    table |= {"timestamp": TIME, "episode_index": np.zeros(N, int), "task": ["peg"] * N}
    pq.write_table(pa.table(table), folder / "file-000.parquet")
    names = [f"{JOINTS[j]}.pos" for j in reversed(range(7))]  # the information decides, not the order of the robot
    features = {key: {"dtype": "float32", "shape": [7], "names": names} for key in lists}
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps({"features": features}))
    assert convert(folder / "file-000.parquet", "iiwa14", tmp_path / "rig", guess=True, yes=True) == 0
    rec = load(tmp_path / "rig")
    assert np.allclose(rec.q, Q[:, ::-1], atol=1e-5)
    assert np.allclose(rec.q_cmd, Q[:, ::-1] + 0.01, atol=1e-5)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"a": TIME, "b": Q[:, 0]}, "no columns look like measured angles.*choices: a, b"),
        (numbered("q_{}", Q), "no column looks like the time"),
        ({"1.5": TIME, "2.5": TIME}, "the first line holds numbers"),
        ({"t": TIME[:1]} | numbered("q_{}", Q[:1]), "log.csv: holds a single sample"),
        (
            {"t": np.where(np.arange(len(TIME)) == 9, np.nan, TIME)} | numbered("q_{}", Q) | numbered("dq_{}", DQ),
            "row 11, column t: is missing or infinite.*rate_hz",
        ),
    ],
)
def test_what_cannot_be_guessed(tmp_path, columns, words):
    with pytest.raises(UserError, match=words):
        convert(write_table(tmp_path / "log.csv", columns), "iiwa14", guess=True)
    (tmp_path / "run.bag").touch()
    with pytest.raises(UserError, match="cannot be guessed.*bags name"):
        convert(tmp_path / "run.bag", "iiwa14", guess=True)


@pytest.mark.skipif(not (SHARED / "data" / "so101").is_dir(), reason="the real logs are not here")
def test_a_real_servo_arms_log(tmp_path, capsys):
    file = SHARED / "data" / "so101" / "chirp_sweep.csv.gz"
    names = ("Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll", "Jaw")
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = "".join(f'<link name="l{i}">{inertial}</link>' for i in range(7))
    joints = "".join(
        f'<joint name="{n}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" velocity="6" effort="3"/></joint>'
        for i, n in enumerate(names)
    )
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{links}{joints}</robot>')
    assert convert(file, str(tmp_path / "arm.urdf"), tmp_path / "rig", guess=True, yes=True) == 0
    said = capsys.readouterr().out
    rec = load(tmp_path / "rig")
    assert rec.joints == names and len(rec.time) == 6000 and rec.rate_hz == 50
    assert rec.q_cmd is not None and rec.dq is not None and rec.tau is None
    assert "q_cmd.Jaw: {column: goal_rad_Jaw, unit: rad}" in said and "called as the robot's joints" not in said
