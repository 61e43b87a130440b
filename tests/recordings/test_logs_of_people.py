"""Logs in the forms in which people have them: from the file to the comparison, each kind made here."""

from __future__ import annotations

import json
import os
from pathlib import Path

import mujoco
import numpy as np
import pytest

from vispeg.api.compare import compare
from vispeg.api.recording.convert import convert
from vispeg.api.recording.guess import propose
from vispeg.core.errors import UserError
from vispeg.recordings.importers.mapping import map_from
from vispeg.recordings.load import load
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Dialect, Reading

CASES = Path(os.environ.get("VISPEG_SHARED", Path(__file__).resolve().parents[3] / "shared")) / "cases"
JOINTS = ("base_joint", "lift_joint", "elbow_joint", "roll_joint")
ARM = """<mujoco model="four"><compiler angle="radian"/><default><geom contype="0" conaffinity="0"/></default>
<worldbody><body name="a" pos="0 0 .2"><joint name="base_joint" axis="0 0 1" range="-3.1 3.1"/>
<geom type="capsule" fromto="0 0 0 0.1 0 .1" size=".05" mass="4"/>
<body name="b" pos="0.1 0 .1"><joint name="lift_joint" axis="0 1 0" range="-3.1 3.1"/>
<geom type="capsule" fromto="0 0 0 .4 0 0" size=".04" mass="3"/>
<body name="c" pos=".4 0 0"><joint name="elbow_joint" axis="0 1 0" range="-3.1 3.1"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="2"/>
<body name="d" pos=".3 0 0"><joint name="roll_joint" axis="1 0 0" range="-3.1 3.1"/>
<geom type="box" pos=".05 .06 0" size=".05 .05 .03" mass=".8"/></body></body></body></body></worldbody></mujoco>"""
RATE, N = 100.0, 800
TIME = np.arange(N) / RATE
Q = np.stack([(0.9 - 0.1 * j) * np.sin(2 * np.pi * (0.35 + 0.12 * j) * TIME + j) for j in range(4)], 1)
DQ, DDQ = np.gradient(Q, TIME, axis=0), np.gradient(np.gradient(Q, TIME, axis=0), TIME, axis=0)


def torques():
    model = mujoco.MjModel.from_xml_string(ARM)
    data, out = mujoco.MjData(model), np.empty_like(Q)
    for k in range(N):
        data.qpos[:], data.qvel[:], data.qacc[:] = Q[k], DQ[k], DDQ[k]
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse
    return out + np.random.default_rng(4).normal(scale=0.03, size=out.shape)


TAU = torques()


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    return str(tmp_path / "arm.xml")


def table(file, columns, separator=",", before="", header=True):
    rows = [before + (separator.join(columns) + "\n" if header else "")]
    for row in zip(*columns.values(), strict=True):
        rows.append(separator.join(x if isinstance(x, str) else repr(float(x)) for x in row) + "\n")
    file.write_text("".join(rows))
    return file


def numbered(word, values):
    return {f"{word}_{k}": values[:, k] for k in range(values.shape[1])}


def taken(file, arm, out, **options):
    """The recording that the proposal makes, and the proposal."""
    sensor = options.pop("torque_sensor", None)
    guessed = propose(file, arm, sensor, **options)
    return convert(file, arm, out, mapping=guessed.mapping), guessed


LISTED = str([JOINTS[j] for j in (2, 1, 0, 3)])
ORDER = (2, 1, 0, 3)
PLAIN = {"time": TIME} | numbered("q", Q) | numbered("tau", TAU)
FORMS = {  # columns, keywords of `table`, and what the proposal has to say
    "names in a column": (
        {"Time": 1.7e9 + TIME, "name": [LISTED] * N}
        | numbered("position", Q[:, ORDER])
        | numbered("effort", TAU[:, ORDER]),
        {"separator": ";"},
        None,
    ),
    "no names, another order": (
        {"Time": TIME} | numbered("position", Q[:, ORDER]) | numbered("effort", TAU[:, ORDER]),
        {},
        "another order than the file's fits the model",
    ),
    "joints' own names": (
        {"time": TIME} | {j: Q[:, k] for k, j in enumerate(JOINTS)} | numbered("tau", TAU),
        {},
        None,
    ),
    "0 to 360 degrees": (
        {"time": TIME} | numbered("position", np.degrees(Q) % 360) | numbered("torque", TAU),
        {},
        "angles wrap at a whole turn",
    ),
    "-pi to pi about pi": (
        {"time": TIME} | numbered("position", (Q + 2 * np.pi) % (2 * np.pi)) | numbered("torque", TAU),
        {},
        "angles wrap at a whole turn",
    ),
    "rows twice": (
        {name: np.repeat(v, np.where(np.arange(N) % 10 == 3, 2, 1)) for name, v in PLAIN.items()},
        {},
        "80 rows left out: the same as the one before",
    ),
    "comments before the header": (PLAIN, {"before": "# gains=high\n\n% payload, 90 g\n"}, "2 lines before the header"),
    "blanks and a commented header": (
        PLAIN,
        {"separator": "  ", "header": False, "before": "# " + " ".join(PLAIN) + "\n"},
        None,
    ),
    "a separator stated for Excel": (PLAIN, {"separator": ";", "before": '"sep=;"\n'}, None),
    "dates": (
        PLAIN | {"time": [str(np.datetime64("2026-03-28T23:59:58.500000") + int(1e6 * t)) for t in TIME]},
        {},
        None,
    ),
    "dates of a zone": (
        {"stamp": [f"{np.datetime64('2026-03-28T23:59:58') + np.timedelta64(int(1e9 * t), 'ns')}+01:00" for t in TIME]}
        | {name: values for name, values in PLAIN.items() if name != "time"},
        {},
        None,
    ),
    "times of day": (PLAIN | {"time": [f"23:01:{12.0078125 + t:09.6f}" for t in TIME]}, {"separator": "\t"}, None),
    "units alone": (
        {"time": TIME}
        | {f"J{k + 1} [deg]": np.degrees(Q[:, k]) for k in range(4)}
        | {f"M{k + 1} [Nm]": TAU[:, k] for k in range(4)},
        {"separator": "\t"},
        None,
    ),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_table_comes_back_as_it_was_measured(form, tmp_path, arm):
    columns, keywords, said = FORMS[form]
    rec, guessed = taken(table(tmp_path / "log.txt", columns, **keywords), arm, tmp_path / "rig", torque_sensor="joint")
    np.testing.assert_allclose(rec.q, Q, atol=1e-9)
    np.testing.assert_allclose(rec.tau, TAU, atol=1e-9)
    np.testing.assert_allclose(rec.time - rec.time[0], TIME, atol=1e-6)
    if said:
        assert said in str(guessed)
    assert len(guessed.proposal.rows) == 3  # the rows that decided


def test_another_order_is_proposed_only_where_the_model_asks_for_it(tmp_path, arm):
    right = table(tmp_path / "right.csv", PLAIN)
    assert "another order" not in str(propose(right, arm, "joint"))
    heavy = table(tmp_path / "heavy.csv", PLAIN | numbered("tau", 1.4 * TAU + 2 * np.sign(DQ)))
    assert "another order" not in str(propose(heavy, arm, "joint"))  # a payload and friction are no order


def current(scale, silent):
    """Motor currents of the arm: A a N m, dry friction, and a joint that carries nothing."""
    amperes = scale * (TAU + 0.5 * np.tanh(50 * DQ))
    amperes[:, silent] = 0.01 * np.round(np.random.default_rng(1).normal(size=N))
    return amperes


@pytest.mark.parametrize("word", ["effort", "actual_current"])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_current_is_scaled_by_the_model_and_said(word, tmp_path, arm):
    scale = np.array([0.09, -0.06, 0.12, 0.1])
    file = table(tmp_path / "log.csv", {"time": TIME} | numbered("q", Q) | numbered(word, current(scale, 3)))
    rec, guessed = taken(file, arm, tmp_path / "rig")
    said = str(guessed)
    assert "by 0.06 to 0.12, reversed at lift_joint: looks like a current; left out, as their readings carry no" in said
    assert rec.torque_sensor == "motor" and np.isnan(rec.tau[:, 3]).all()
    for j in range(3):
        model = TAU[:, j] + 0.5 * np.tanh(50 * DQ[:, j])
        assert np.polyfit(model, rec.tau[:, j], 1)[0] == pytest.approx(1, abs=0.05), JOINTS[j]
    torque = table(
        tmp_path / "torque.csv", {"time": TIME} | numbered("q", Q) | numbered("effort", TAU + 0.5 * np.sign(DQ))
    )
    assert "looks like a current" not in str(propose(torque, arm))


def test_goals_and_angles_without_torque_are_a_servo_of_unknown_gains(tmp_path, arm):
    late = np.roll(Q, 3, axis=0)
    late[:3] = Q[0]
    goals = np.where((np.arange(N) % 5 == 0)[:, None], Q, np.nan)  # come at a fifth of the rate
    columns = {"time": TIME} | numbered("actual_q", late) | numbered("target_q", goals)
    file = table(tmp_path / "log.csv", columns)
    file.write_text(file.read_text().replace("nan", ""))
    with pytest.warns(UserWarning, match="each holds until the next"):
        rec, guessed = taken(file, arm, tmp_path / "rig")
    assert rec.control.mode == "servo" and "servo is proposed" in str(guessed)
    np.testing.assert_allclose(rec.q_cmd[7], Q[5])
    still = {"time": TIME} | numbered("actual_q", Q) | numbered("target_q", Q[:, ::-1] * 0 + np.cos(7 * TIME)[:, None])
    assert "do not follow the goals" in str(propose(table(tmp_path / "other.csv", still), arm))


def test_a_clock_that_steps_back_is_cut_and_one_that_stands_is_refused(tmp_path, arm):
    back = TIME - np.where(np.arange(N) >= 300, 0.2, 0.0)
    file = table(tmp_path / "log.csv", PLAIN | {"time": back})
    with pytest.warns(UserWarning, match="the clock stepped back by 0.19 s at row 302: an episode ends there"):
        rec, _ = taken(file, arm, tmp_path / "rig", torque_sensor="joint")
    assert np.flatnonzero(np.diff(rec.episode)).tolist() == [299]
    stands = TIME.copy()
    stands[300] = stands[299]
    guessed = propose(table(tmp_path / "stands.csv", PLAIN | {"time": stands}), arm, "joint")
    with pytest.raises(UserError, match="row 302: two rows of one time with other values"):
        convert(tmp_path / "stands.csv", arm, tmp_path / "other", mapping=guessed.mapping)


def test_what_precedes_a_step_back_keeps_the_files_episode(tmp_path, arm):
    """Outcomes refer to the file's numbers: 5, 9 and 2, of which 9 is in two pieces, whose second gets a new number."""
    number = np.repeat([5, 9, 2], [200, 400, N - 600])
    back = TIME - np.where((np.arange(N) >= 300) & (np.arange(N) < 600), 0.2, 0.0)
    file = table(tmp_path / "log.csv", PLAIN | {"time": back, "episode": number})
    outcomes = [{"success": True, "episode": 9}, {"success": False, "episode": 2}]
    mapping = {f"q.{joint}": f"q_{j}" for j, joint in enumerate(JOINTS)} | {"episode": "episode"}
    mapping |= {"recording": {"outcome": outcomes}}
    with pytest.warns(UserWarning, match="the clock stepped back"):
        rec = convert(file, arm, tmp_path / "rig", mapping=map_from(mapping, file, JOINTS))
    pieces = dict.fromkeys(rec.episode.tolist())
    assert [(k, int(np.sum(rec.episode == k))) for k in pieces] == [(5, 200), (9, 100), (10, 300), (2, N - 600)]
    assert [(o.episode, o.success) for o in load(tmp_path / "rig").outcomes] == [(9, True), (2, False)]


def test_a_joint_that_spins_farther_than_a_recording_holds_is_refused(tmp_path):
    """Nothing could read the recording."""
    (tmp_path / "spin.xml").write_text(ARM.replace('axis="0 0 1" range="-3.1 3.1"', 'axis="0 0 1"'))
    spun = {f"q.{joint}": Q[:, k] for k, joint in enumerate(JOINTS)} | {"q.base_joint": 2.0 * TIME % (2 * np.pi)}
    with pytest.raises(UserError, match="q.base_joint: wraps, and turns too far.*2.54 turns"):
        convert(table(tmp_path / "log.csv", {"time": TIME} | spun), str(tmp_path / "spin.xml"), tmp_path / "rig")
    assert not (tmp_path / "rig").exists()


def test_missing_commands_have_no_say_in_the_turn(tmp_path, arm):
    """Readings and commands a turn above the range; of the commands the first half is missing."""
    cmd = Q + 2 * np.pi
    cmd[: N // 2 + 1] = np.nan
    columns = {"time": TIME} | numbered("q", Q + 2 * np.pi) | numbered("c", cmd)
    file = table(tmp_path / "log.csv", columns)
    lines = {f"{s}.{joint}": f"{c}_{j}" for s, c in (("q", "q"), ("q_cmd", "c")) for j, joint in enumerate(JOINTS)}
    with pytest.warns(UserWarning, match="whole turn"):
        rec = convert(file, arm, tmp_path / "rig", mapping=map_from({"time": "time"} | lines, file, JOINTS))
    np.testing.assert_allclose(rec.q, Q, atol=1e-9)
    np.testing.assert_allclose(rec.q_cmd[N // 2 + 1 :], Q[N // 2 + 1 :], atol=1e-9)


STORED = {"obs/qpos": Q, "obs/qvel": DQ, "obs/effort": TAU}


def hdf5(file):
    h5py = pytest.importorskip("h5py")
    with h5py.File(file, "w") as store:
        for name, values in STORED.items():
            store[name] = values
        store["obs/images"] = np.zeros((N, 4, 4, 3), np.uint8)
    return file


def droid(file):
    h5py = pytest.importorskip("h5py")
    with h5py.File(file, "w") as store:
        for name, values in {"positions": Q, "velocities": DQ, "torques": TAU}.items():
            store[f"state/joint_{name}"] = values
        store["stamp/seconds"], store["stamp/nanos"] = (
            17 * 10**8 + TIME.astype(int),
            np.round(TIME % 1 * 1e9).astype(int),
        )
    return file


def demos(file):
    h5py = pytest.importorskip("h5py")
    with h5py.File(file, "w") as store:
        for k, rows in enumerate((slice(0, 500), slice(500, N))):
            for name, values in STORED.items():
                store[f"data/demo_{k}/{name}"] = values[rows]
    return file


def mat(file):
    from scipy.io import savemat

    savemat(file, {"log": {"t": TIME, "q": Q.T, "dq": DQ.T, "tau": TAU.T}})
    return file


def npy(file):
    np.save(file, np.column_stack([TIME, Q, DQ, TAU]))
    return file


def npz(file):
    np.savez(file, qpos=Q, qvel=DQ, torque=TAU)
    return file


def jsonl(file):
    rows = zip(TIME.tolist(), Q.tolist(), DQ.tolist(), TAU.tolist(), strict=True)
    file.write_text("".join(json.dumps({"t": t, "state": {"q": q, "dq": v, "tau": f}}) + "\n" for t, q, v, f in rows))
    return file


def signals(file):
    file.mkdir()
    late = TIME[::2] + 0.004
    for name, time, values in (("position", TIME, Q), ("velocity", TIME, DQ), ("effort", TIME, TAU)):
        if name == "effort":
            time, values = late, np.stack([np.interp(late, TIME, TAU[:, j]) for j in range(4)], 1)
        table(file / f"arm_{name}.csv", {"t": time} | {joint: values[:, k] for k, joint in enumerate(JOINTS)})
    return file


NAMES = ",".join(["time", *(f"{s}{k}" for s in ("q", "dq", "tau") for k in range(4))]).split(",")
STORES = {
    "a.hdf5": (hdf5, {}),
    "d.h5": (droid, {}),
    "demos.hdf5": (demos, {}),
    "a.mat": (mat, {}),
    "a.npy": (npy, {"columns": NAMES}),
    "a.npz": (npz, {"rate_hz": RATE}),
    "a.jsonl": (jsonl, {}),
    "signals": (signals, {}),
}


@pytest.mark.parametrize("name", STORES)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_arrays_and_folders_are_tables_too(name, tmp_path, arm):
    make, options = STORES[name]
    guessed = propose(make(tmp_path / name), arm, "joint", **options)
    rec = convert(tmp_path / name, arm, tmp_path / "rig", mapping=guessed.mapping)
    rows = slice(4, -4) if name == "signals" else slice(None)  # effort begins later, and lies between the readings
    np.testing.assert_allclose(rec.q, Q, atol=1e-9)
    np.testing.assert_allclose(rec.dq, DQ, atol=1e-9)
    np.testing.assert_allclose(rec.tau[rows], TAU[rows], atol=0.3 if name == "signals" else 1e-9)
    if name != "demos.hdf5":
        np.testing.assert_allclose(rec.time - rec.time[0], TIME, atol=1e-6)
    assert rec.rate_hz == RATE and (len(np.unique(rec.episode)) == 2 if name == "demos.hdf5" else rec.episode is None)


def test_a_gap_in_one_file_of_a_folder_stays_a_gap(tmp_path):
    """As in a bag, whose topics are brought onto one clock by the same rule."""
    folder = signals(tmp_path / "signals")
    file = folder / "arm_effort.csv"
    whole = read_table(folder).columns["arm_effort/lift_joint"]
    head, *rows = file.read_text().splitlines()
    there = [row for row in rows if not 3.0 <= float(row.partition(",")[0]) <= 7.0]
    file.write_text("\n".join([head, *there]))
    effort = read_table(folder).columns["arm_effort/lift_joint"]
    inside = (TIME > 2.985) & (TIME < 7.003)  # between the readings at 2.984 and 7.004 s
    assert np.isnan(effort[inside]).all()
    np.testing.assert_array_equal(effort[~inside], whole[~inside])


def test_two_runs_in_each_file_of_a_folder_stay_apart(tmp_path):
    """Their clocks begin again: a torque at 1 s is of the same run as the angle at 1 s."""
    folder = tmp_path / "signals"
    folder.mkdir()
    again = {"t": np.concatenate([TIME, TIME])}
    for name, values in (("position", Q), ("effort", TAU)):
        both = np.concatenate([values, 2.0 * values[::-1]])
        table(folder / f"arm_{name}.csv", again | {joint: both[:, k] for k, joint in enumerate(JOINTS)})
    effort = read_table(folder).columns["arm_effort/lift_joint"]
    np.testing.assert_array_equal(effort, np.concatenate([TAU[:, 1], 2.0 * TAU[::-1, 1]]))
    table(folder / "arm_effort.csv", {"t": TIME, "lift_joint": TAU[:, 1]})
    with pytest.raises(UserError, match="another number of runs; expected 2, as in arm_position.csv; got 1"):
        read_table(folder)


def test_a_joint_with_a_cell_that_is_no_number_is_not_taken_for_one_at_rest(tmp_path, arm):
    """A logger writes None where it has no reading."""
    broken = {**PLAIN, "q_1": [*map(repr, Q[:5, 1].tolist()), "None", *map(repr, Q[6:, 1].tolist())]}
    with pytest.raises(UserError, match="log.csv: row 7, column q_1: is not a number; got 'None'"):
        propose(table(tmp_path / "log.csv", broken), arm)
    (folder := tmp_path / "runs").mkdir()
    for name, columns in (("a.csv", PLAIN), ("b.csv", broken)):
        table(folder / name, columns)
    with pytest.raises(UserError, match=r"runs: row 7, column q_1: is not a number; got 'None \(b.csv\)'"):
        propose(folder, arm)


def test_a_file_of_a_folder_without_samples_is_named(tmp_path, arm):
    folder = signals(tmp_path / "signals")
    head = (folder / "arm_effort.csv").read_text().splitlines()[0]
    (folder / "arm_effort.csv").write_text(head + "\n")
    with pytest.raises(UserError, match="arm_effort.csv: holds no samples"):
        propose(folder, arm, "joint")


def test_a_table_that_numpy_wrote_in_columns_of_equal_width(tmp_path):
    """Every line begins with blanks, the first too, and there is no header."""
    values = np.random.default_rng(0).normal(size=(5, 3))
    np.savetxt(tmp_path / "log.txt", values, fmt="%10.3f")
    read = read_table(tmp_path / "log.txt", Reading(dialect=Dialect(" ")))
    assert read.names == ["1", "2", "3"] and read.rows == 5
    np.testing.assert_allclose(np.column_stack([read.columns[name] for name in read.names]), values.round(3))


@pytest.mark.parametrize(("separator", "empty"), [(",", "\n"), (";", "  \t\r\n"), ("\t", "\n \n"), (" ", "\n")])
@pytest.mark.parametrize("text", [False, True])
def test_empty_lines_are_no_samples_and_rows_keep_their_numbers(separator, empty, text, tmp_path):
    """Of a table read as a whole, or cell by cell as one with a column of text is; blocks of it are told their rows."""
    values = np.random.default_rng(1).normal(size=(40_000, 3))
    cells = [[*map(repr, row), *(["on"] if text else [])] for row in values.tolist()]
    lines = [separator.join(row) + "\n" for row in [["a", "b", "c", *(["d"] if text else [])], *cells]]
    after = [0, 3, 3, 20_000, 39_999]  # lines, the header among them, behind which empty ones stand
    spread = [line + empty * after.count(k) for k, line in enumerate(lines)]
    (tmp_path / "log.csv").write_text("".join(spread) + "\n \n", newline="")
    seen = []
    table = read_table(tmp_path / "log.csv", Reading(look=seen.append, dialect=Dialect(separator)))
    assert np.array_equal(np.column_stack([table.columns[name] for name in "abc"]), values)
    at = [n for n, line in enumerate("".join(spread).split("\n"), 1) if line.strip()][1:]
    assert [int(n) for n in table.numbers] == at and [int(n) for block in seen for n in block.numbers] == at
    assert table.row(39_999) == f"row {at[-1]}"


def test_an_empty_line_of_one_column_is_an_empty_cell(tmp_path):
    for cells, column in ((["1", "", "3"], [1, np.nan, 3]), (["1", "", "on"], None)):
        (tmp_path / "log.csv").write_text("\n".join(["a", *cells]))
        table = read_table(tmp_path / "log.csv")
        assert np.array_equal(table.columns["a"], column, True) if column else table.text["a"] == (4, "on")


def test_a_row_without_its_time_is_named(tmp_path, arm):
    """As a row whose cells were cleared in a spreadsheet, which leaves the separators."""
    file = table(tmp_path / "log.csv", PLAIN)
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:400], "," * (len(PLAIN) - 1), *lines[400:]]))
    with pytest.raises(UserError, match="row 401, column time: is missing or infinite; expected a time in every row"):
        propose(file, arm)


def test_dates_have_no_unit_and_one_form(tmp_path, arm):
    dates = [f"2026-03-28T12:00:{t:09.6f}Z" for t in TIME]
    file = table(tmp_path / "log.csv", PLAIN | {"time": dates})
    signals = {f"q.{joint}": f"q_{j}" for j, joint in enumerate(JOINTS)}
    mapping = map_from({"time": {"column": "time", "unit": "ms"}} | signals, file, JOINTS)
    with pytest.raises(UserError, match="time: holds dates or times of day; expected no unit, no scale"):
        convert(file, arm, tmp_path / "rig", mapping=mapping)
    mapping = map_from({"time": "time"} | signals, file, JOINTS)
    for cell, wrong in (("4.5", "is not a date"), ("2026-03-28T25:00:00Z", "is not a date")):
        table(file, PLAIN | {"time": [*dates[:300], cell, *dates[301:]]})
        with pytest.raises(UserError, match=f"row 302, column time: {wrong}"):
            convert(file, arm, tmp_path / "rig", mapping=mapping)


def test_dates_are_the_same_seconds_as_text_and_in_parquet(tmp_path):
    """Text is read as a whole, or cell by cell where another column has a word."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    stamps = np.datetime64("2026-03-28T23:59:58", "us") + np.random.default_rng(2).integers(0, 10**9, 50)
    of_day = stamps - stamps.astype("datetime64[D]")
    columns = {"at": pa.array(stamps), "day": pa.array(of_day.astype(int), pa.time64("us"))}
    pq.write_table(pa.table(columns | {"x": pa.array(np.arange(50.0))}), tmp_path / "log.parquet")
    times = {"at": [str(at) for at in stamps], "day": [str(at)[11:] for at in stamps]}
    read = [read_table(tmp_path / "log.parquet")]
    for x in (np.arange(50.0), ["on", *map(str, range(49))]):
        read.append(read_table(table(tmp_path / "log.csv", times | {"x": x})))
    for name, seconds in (("at", stamps.astype(int) / 1e6), ("day", of_day.astype(int) / 1e6)):
        assert all(np.array_equal(t.columns[name], seconds) and name in t.dates for t in read)


def test_a_row_behind_repeated_ones_is_told_by_its_number_in_the_file(tmp_path, arm):
    twice = {name: np.insert(values, 100, values[100]) for name, values in PLAIN.items()}
    twice["q_1"][400] = np.inf
    file = table(tmp_path / "log.csv", twice)
    mapping = map_from({f"q.{joint}": f"q_{j}" for j, joint in enumerate(JOINTS)}, file, JOINTS)
    with (
        pytest.warns(UserWarning, match="1 row left out"),
        pytest.raises(UserError, match=r"row 402, column q_1 \(q\.lift_joint\): is infinite"),
    ):
        convert(file, arm, tmp_path / "rig", mapping=mapping)


def test_what_is_not_read_says_how_to_get_a_table(tmp_path, arm):
    for name, words in (("log.xlsx", "read_excel"), ("log.pkl", "never opened")):
        (tmp_path / name).touch()
        with pytest.raises(UserError, match=words):
            convert(tmp_path / name, arm, tmp_path / "rig")
    numbers = table(tmp_path / "log.txt", PLAIN, separator=" ", header=False)
    with pytest.raises(UserError, match="first line holds numbers; expected columns with 9 names"):
        propose(numbers, arm)
    assert propose(numbers, arm, "joint", columns=list(PLAIN)).proposal.joints == list(JOINTS)


SO101 = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
RANGES = (2549, 2303, 2204, 1484)


def lerobot(folder, names=JOINTS, degrees=False, version=3, still=False):
    """A LeRobot data set of two episodes: angles as whole encoder ticks of each joint's calibrated range."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    ticks = np.round((Q + [0, 0, 0, 1.2]) * 4096 / (2 * np.pi))
    ticks[:, 3] = 40 if still else ticks[:, 3]
    full = np.array([200, 200, 200, 100])
    values = ticks * 360 / 4095 if degrees else ticks * full / RANGES
    tables = []
    for k, rows in enumerate((slice(0, 500), slice(500, N))):
        lists = {"observation.state": values[rows], "action": values[rows] + 0.013}
        arrays = {key: pa.FixedSizeListArray.from_arrays(v.astype(np.float32).ravel(), 4) for key, v in lists.items()}
        n = len(values[rows])
        arrays |= {"timestamp": np.arange(n) / np.float32(RATE), "episode_index": np.full(n, k)}
        tables.append(pa.table(arrays | {"frame_index": np.arange(n)}))
    (folder / "data" / "chunk-000").mkdir(parents=True)
    (folder / "meta").mkdir()
    if version == 3:
        pq.write_table(pa.concat_tables(tables), folder / "data" / "chunk-000" / "file-000.parquet")
    else:
        for k, part in enumerate(tables):
            pq.write_table(part, folder / "data" / "chunk-000" / f"episode_{k:06d}.parquet")
    motors = [f"{name.removesuffix('_joint')}.pos" for name in names]
    features = {key: {"dtype": "float32", "shape": [4], "names": motors} for key in ("observation.state", "action")}
    (folder / "meta" / "info.json").write_text(json.dumps({"fps": RATE, "features": features}))
    return folder, ticks * 2 * np.pi / 4096


@pytest.mark.parametrize("version", [2, 3])
def test_normalised_units_are_decoded_from_the_encoders_ticks(version, tmp_path):
    names = (*JOINTS[:3], "gripper")
    (tmp_path / "arm.xml").write_text(ARM.replace("roll_joint", "gripper"))
    folder, angles = lerobot(tmp_path / "set", names, version=version)
    rec, guessed = taken(folder, str(tmp_path / "arm.xml"), tmp_path / "rig")
    assert [line.scale for line in guessed.proposal.lines if line.target.startswith("q.")] == pytest.approx(
        [2549 / 200, 2303 / 200, 2204 / 200, 1484 / 100]
    )
    np.testing.assert_allclose(rec.q, angles + [0, 0, 0, -3.1], atol=1e-5)  # 0 % is the lower limit of the model
    goal = 0.013 * np.array([2549 / 200, 2303 / 200, 2204 / 200, 1484 / 100]) * 2 * np.pi / 4096
    np.testing.assert_allclose(rec.q_cmd - rec.q, np.tile(goal, (N, 1)), atol=1e-6)  # the goal has the same scale
    assert len(np.unique(rec.episode)) == 2 and rec.control.mode == "servo"
    assert "2549 encoder ticks, of which all" in str(guessed) and "per cent of 1484" in str(guessed)


def test_degrees_of_whole_ticks_are_degrees_and_a_calibration_counts_where_nothing_moves(tmp_path, arm):
    folder, angles = lerobot(tmp_path / "set", degrees=True)
    rec, guessed = taken(folder, arm, tmp_path / "rig")
    np.testing.assert_allclose(rec.q, angles * 4096 / 4095, atol=1e-6)
    assert "whole encoder ticks of 0.087912 degrees" in str(guessed)
    ranges = {
        name.removesuffix("_joint"): (100, 100 + span) for name, span in zip(JOINTS, (*RANGES[:3], 3000), strict=True)
    }
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps({k: {"range_min": a, "range_max": b, "id": 1} for k, (a, b) in ranges.items()}))
    folder, _ = lerobot(tmp_path / "other", still=True)
    said = str(propose(folder, arm, calibration=file))
    assert "of 2549 encoder ticks" in said and "of 3000 encoder ticks, as its calibration says" in said
    file.unlink()
    lines = {line.target: line for line in propose(folder, arm).proposal.lines}
    assert lines[f"q.{JOINTS[0]}"].sure == "measured"
    assert lines[f"q.{JOINTS[3]}"].sure == "likely" and lines[f"q.{JOINTS[3]}"].why.endswith("which is a guess")


@pytest.mark.skipif(not CASES.is_dir(), reason="the shared cases are not here")
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_cases_of_people_give_their_right_answers(tmp_path):
    """What each case of the shared folder says is right."""
    small = {n[:2]: CASES / n for n in os.listdir(CASES) if n[:2].isdigit()}
    for number, file in (("05", "joint_states.csv"), ("07", "log.csv"), ("08", "log.csv"), ("09", "log.csv")):
        arm = str(small[number] / "arm.xml")
        rec, _ = taken(small[number] / file, arm, tmp_path / number, torque_sensor="joint")
        assert len(rec.time) == 1000
        assert error_of(tmp_path / number, arm) < 0.3, number
    joints = (
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "elbow_joint",
        "wrist_1_joint",
        "wrist_2_joint",
        "wrist_3_joint",
    )
    rec, _ = taken(
        small["02"] / "log.csv", str(small["02"] / "arm_gripper.xml"), tmp_path / "02", torque_sensor="joint"
    )
    assert rec.joints == joints and error_of(tmp_path / "02", str(small["02"] / "arm_gripper.xml")) < 0.3
    rec, _ = taken(small["06"] / "positions.csv", str(small["06"] / "arm.xml"), tmp_path / "06")
    assert rec.joints == joints
    rec, _ = taken(small["10"] / "log.csv", str(small["10"] / "arm.xml"), tmp_path / "10")
    assert rec.control.mode == "servo"
    for file in ("episode_0.hdf5", "trajectory.h5"):
        rec, _ = taken(small["11"] / file, str(small["05"] / "arm.xml"), tmp_path / file)
        assert rec.rate_hz == 125 and rec.tau is not None and rec.q_cmd is not None
    rest = "".join(
        f'<body name="b{i}"><joint name="{j}" axis="0 1 0" range="{low} 2"/><geom size=".02" pos=".1 0 0" mass=".1"/>'
        for i, (j, low) in enumerate(zip(SO101, (-2, -2, -2, -2, -2, -0.174533), strict=True))
    )
    (tmp_path / "so.xml").write_text(
        f"<mujoco><compiler angle='radian'/><worldbody>{rest}{'</body>' * 6}</worldbody></mujoco>"
    )
    rec, _ = taken(small["01"], str(tmp_path / "so.xml"), tmp_path / "01")
    truth = np.genfromtxt(small["01"] / "truth_rad.csv", delimiter=",", skip_header=1)[:, 1:]
    np.testing.assert_allclose(rec.q, truth, atol=2e-3)  # a tick is 1.5e-3 rad
    from vispeg.robots.model import load as robot

    assert robot(small["03"] / "three.urdf").joints == ("j1", "j2", "j3")


def error_of(recording, arm):
    """Torque error of the nominal model, N m RMS."""
    return float(compare(arm, recording).error)
