"""Headers as robots and tools write them: the whole map is proposed, and converting with it gives the motion back."""

from __future__ import annotations

import gzip
import json
import os
from pathlib import Path

import numpy as np
import pytest

from vispeg.cli.recordings.convert import Args
from vispeg.core.errors import UserError
from vispeg.recordings.load import load

SHARED = Path(os.environ.get("VISPEG_SHARED", Path(__file__).resolve().parents[3] / "shared"))
JOINTS = tuple(f"joint{i}" for i in range(1, 8))
N = 400
TIME = 0.002 * np.arange(N)
Q = np.stack([0.6 * np.sin(2 * np.pi * (0.6 + 0.1 * j) * TIME + j) - 1.1 * (j == 3) for j in range(7)], 1)
DQ = np.gradient(Q, TIME, axis=0)
TAU = 5.0 * np.cos(3 * TIME[:, None] + np.arange(7))
ALPHABETICAL = (2, 5, 0, 1, 3, 4, 6)


def numbered(pattern, values, first=0, order=range(7)):
    return {pattern.format(k + first): values[:, j] for k, j in enumerate(order)}


STYLES = {  # columns -> what has to come back
    "own words": (
        {"t_ms": 1e3 * TIME} | numbered("pos_{} [deg]", np.degrees(Q), 1) | numbered("load_{}_mNm", 1e3 * TAU, 1),
        ("q", "tau"),
    ),
    "degrees, and speeds in rad/s": (
        {"t_ms": 1e3 * TIME}
        | numbered("pos_{}_deg", np.degrees(Q))
        | numbered("vel_{}", DQ)
        | numbered("goal_{}_deg", np.degrees(Q + 0.01))
        | numbered("goalvel_{}", DQ),
        ("q", "dq", "q_cmd"),
    ),
    "radians, and speeds in deg/s": (
        {"stamp": 1e3 * TIME} | numbered("q_{}", Q) | numbered("qd_{}", np.degrees(DQ)),
        ("q", "dq"),
    ),
    "franka": (
        {"time": 1e3 * TIME}
        | numbered("q_{}", Q)
        | numbered("q_d_{}", Q + 0.01)
        | numbered("dq_{}", DQ)
        | numbered("dq_d_{}", DQ)
        | numbered("tau_J_{}", TAU)
        | numbered("tau_J_d_{}", TAU)
        | numbered("tau_ext_hat_filtered_{}", 9 * TAU)
        | numbered("ddq_d_{}", TAU)
        | numbered("theta_{}", Q + 3),
        ("q", "dq", "tau", "tau_cmd", "q_cmd", "dq_cmd"),
    ),
    "franka, brackets": (
        {"robot_state.time": TIME} | numbered("q[{}]", Q) | numbered("dq[{}]", DQ) | numbered("tau_J[{}]", TAU),
        ("q", "dq", "tau"),
    ),
    "universal robots": (
        {"timestamp": 5e5 + TIME}
        | numbered("target_q_{}", Q + 0.01)
        | numbered("actual_q_{}", Q)
        | numbered("target_qd_{}", DQ)
        | numbered("actual_qd_{}", DQ)
        | numbered("actual_current_{}", 8 * TAU),
        ("q", "dq", "q_cmd", "dq_cmd"),
    ),
    "kuka rsi": (
        {"Timestamp [us]": 1e6 * TIME}
        | numbered("AIPos.A{}", np.degrees(Q), 1)
        | numbered("ASPos.A{}", np.degrees(Q + 0.01), 1)
        | numbered("MACur.A{}", TAU, 1),
        ("q", "q_cmd"),
    ),
    "joint states echoed": (
        {"%time": 1.7e18 + 1e9 * TIME, "field.header.seq": np.arange(N), "field.header.stamp": 1.7e18 + 1e9 * TIME}
        | {f"field.name{k}": [JOINTS[j]] * N for k, j in enumerate(ALPHABETICAL)}
        | numbered("field.position{}", Q, 0, ALPHABETICAL)
        | numbered("field.velocity{}", DQ, 0, ALPHABETICAL)
        | numbered("field.effort{}", TAU, 0, ALPHABETICAL),
        ("q", "dq", "tau"),
    ),
    "plotjuggler": (
        {"__time": 1.7e9 + TIME}
        | {f"/joint_states/{JOINTS[j]}/position": Q[:, j] for j in ALPHABETICAL}
        | {f"/joint_states/{JOINTS[j]}/velocity": DQ[:, j] for j in ALPHABETICAL},
        ("q", "dq"),
    ),
    "lerobot": (
        {"timestamp": TIME, "frame_index": np.arange(N), "episode_index": np.zeros(N), "index": np.arange(N)}
        | {f"observation.state.{j}.pos": np.degrees(Q[:, k]) for k, j in enumerate(JOINTS)}
        | {f"action.{j}.pos": np.degrees(Q[:, k]) + 0.5 for k, j in enumerate(JOINTS)},
        ("q", "q_cmd"),
    ),
    "german": (
        {"Zeit [ms]": 1e3 * TIME}
        | numbered("Winkel A{} [Grad]", np.degrees(Q), 1)
        | numbered("Drehmoment A{} [Nm]", TAU, 1),
        ("q", "tau"),
    ),
    "no units, degrees": (
        {"Time": TIME} | numbered("J{}", np.zeros_like(Q), 1) | numbered("J{} angle", np.degrees(Q), 1),
        ("q",),
    ),
}
TRUTH = {"q": Q, "dq": DQ, "tau": TAU, "tau_cmd": TAU, "q_cmd": Q + 0.01, "dq_cmd": DQ}


def write_table(file, columns, separator=",", decimal="."):
    rows = [separator.join(columns)]
    for row in zip(*columns.values(), strict=True):
        rows.append(separator.join(str(x) if isinstance(x, str) else repr(float(x)).replace(".", decimal) for x in row))
    data = ("\n".join(rows) + "\n").encode()
    file.write_bytes(gzip.compress(data) if file.suffix == ".gz" else data)
    return file


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.filterwarnings("ignore:.*torque_sensor")
def test_a_whole_map_is_proposed(tmp_path, style, capsys):
    columns, signals = STYLES[style]
    german = style == "german"
    file = write_table(tmp_path / ("log.csv.gz" if german else "log.csv"), columns, *((";", ",") if german else ()))
    assert Args(file, "iiwa14", tmp_path / "rig", guess=True, yes=True, save_map=tmp_path / "map.yaml").run() == 0
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
    assert (
        Args(file, "iiwa14", tmp_path / "again", map=tmp_path / "map.yaml").run() == 0
    )  # what is saved is what is used
    assert (tmp_path / "again" / "samples.csv").read_bytes() == (tmp_path / "rig" / "samples.csv").read_bytes()


def test_what_is_not_used_and_what_more_knowledge_buys_is_said(tmp_path, capsys):
    file = write_table(tmp_path / "log.csv", STYLES["franka"][0] | {"note": ["ok"] * N})
    assert Args(file, "iiwa14", guess=True).run() == 0
    said = capsys.readouterr().out
    assert "not used: tau_ext_hat_filtered_0 (an estimate of external torque" in said
    assert "torque_sensor: joint is guessed" in said and "inverse dynamics" in said
    assert "control: {mode: position" in said and "7 numbers, N m/rad" in said and "delays, gear play" in said
    assert [p.name for p in tmp_path.iterdir()] == ["log.csv"]


def test_a_guess_is_confirmed_or_nothing_is_written(tmp_path, monkeypatch, capsys):
    file = write_table(tmp_path / "log.csv", STYLES["plotjuggler"][0])
    with pytest.raises(UserError, match="must be confirmed.*--yes.*--save-map"):
        Args(file, "iiwa14", tmp_path / "rig", guess=True).run()
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    for answer, there in (("", False), ("n", False), ("y", True)):
        monkeypatch.setattr("builtins.input", lambda _, answer=answer: answer)
        assert Args(file, "iiwa14", tmp_path / "rig", guess=True).run() == 0
        assert (tmp_path / "rig").exists() == there, answer
    with pytest.raises(UserError, match="map is given already"):
        Args(file, "iiwa14", guess=True, map=tmp_path / "m.yaml").run()


def test_doubts_are_said(tmp_path, capsys):
    names = ("Rotation", "Pitch", "Elbow", "Wrist", "Roll", "Jaw", "Grip")
    columns = {"t": TIME} | {f"goal_rad_{n}": Q[:, k] for k, n in enumerate(names)}
    columns |= {f"angle_rad_{n}": Q[:, k] for k, n in enumerate(names)}
    columns |= {f"load_nm_{n}": np.abs(TAU[:, k]) for k, n in enumerate(names)}
    assert Args(write_table(tmp_path / "log.csv", columns), "iiwa14", guess=True).run() == 0
    said = capsys.readouterr().out
    assert "q_cmd.joint3: {column: goal_rad_Elbow, unit: rad}" in said and "elbow is joint3" in said
    assert "torque_sensor: " not in said and "load_nm_Jaw (never negative" in said and "nothing can be compared" in said
    own = (
        {"time": TIME}
        | {f"q.{j}": Q[:, k] for k, j in enumerate(JOINTS)}
        | {f"tau.{j}": TAU[:, k] for k, j in enumerate(JOINTS)}
    )
    assert Args(write_table(tmp_path / "own.csv", own), "iiwa14", guess=True).run() == 0
    assert "no name states where torque was measured" in capsys.readouterr().out
    fewer = {name: values for name, values in STYLES["universal robots"][0].items() if not name.endswith("_6")}
    assert Args(write_table(tmp_path / "six.csv", fewer), "iiwa14", guess=True).run() == 0
    assert "the robot has 7 joints, the file 6" in capsys.readouterr().out


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
    assert Args(folder / "file-000.parquet", "iiwa14", tmp_path / "rig", guess=True, yes=True).run() == 0
    rec = load(tmp_path / "rig")
    assert np.allclose(rec.q, Q[:, ::-1], atol=1e-5)
    assert np.allclose(rec.q_cmd, Q[:, ::-1] + 0.01, atol=1e-5)  # type: ignore[operator]


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"a": TIME, "b": Q[:, 0]}, "no columns look like measured angles.*choices: a, b"),
        (numbered("q_{}", Q), "no column looks like the time"),
        ({"1.5": TIME, "2.5": TIME}, "the first line holds numbers"),
    ],
)
def test_what_cannot_be_guessed(tmp_path, columns, words):
    with pytest.raises(UserError, match=words):
        Args(write_table(tmp_path / "log.csv", columns), "iiwa14", guess=True).run()
    np.savez(tmp_path / "run.npz", a=TIME)
    with pytest.raises(UserError, match="cannot be guessed.*archives and bags name"):
        Args(tmp_path / "run.npz", "iiwa14", guess=True).run()


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
    assert Args(file, str(tmp_path / "arm.urdf"), tmp_path / "rig", guess=True, yes=True).run() == 0
    said = capsys.readouterr().out
    rec = load(tmp_path / "rig")
    assert rec.joints == names and len(rec.time) == 6000 and rec.rate_hz == 50
    assert rec.q_cmd is not None and rec.dq is not None and rec.tau is None
    assert "q_cmd.Jaw: {column: goal_rad_Jaw, unit: rad}" in said and "called as the robot's joints" not in said
