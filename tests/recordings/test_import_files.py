"""Tables and NumPy archives of any naming become the same recording."""

from __future__ import annotations

import numpy as np
import pytest
from made import recording

from vispeg.cli.convert import Args
from vispeg.core.errors import UserError
from vispeg.recordings.importers.mapping import ColumnMap, read_map
from vispeg.recordings.importers.npz import import_npz
from vispeg.recordings.importers.table import import_table
from vispeg.recordings.load import load
from vispeg.recordings.write import write

pytestmark = pytest.mark.filterwarnings("ignore:.*torque_sensor")
JOINTS = ("joint1", "joint2")


def test_a_table_in_degrees_and_milliseconds(tmp_path):
    rec = recording(100)
    degrees = np.rad2deg(rec.q)
    lines = ["t_ms,pos_1,pos_2,load_1,load_2,state"]
    lines += [
        f"{1e3 * t!r},{a!r},{-b!r},{c!r},{d!r},ok"
        for t, (a, b), (c, d) in zip(rec.time.tolist(), degrees.tolist(), (1e3 * rec.tau).tolist(), strict=True)  # type: ignore[operator]
    ]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    (tmp_path / "map.yaml").write_text(
        "time: {column: t_ms, unit: ms}\n"
        "q.joint1: {column: pos_1, unit: deg}\n"
        "q.joint2: {column: pos_2, unit: deg, scale: -1, offset: 0.25}\n"
        "tau.joint1: {column: load_1, unit: mNm}\ntau.joint2: {column: load_2, unit: mNm}\n"
        "recording: {joints: [joint1, joint2], noise: {tau: 0.1}, motion: sines}\n"
    )
    out = tmp_path / "out"
    args = Args(tmp_path / "log.csv", out, "iiwa14", map=tmp_path / "map.yaml", torque_sensor="motor")
    assert args.run() == 0
    back = load(out)
    assert np.allclose(back.time, rec.time, atol=1e-12) and np.allclose(back.tau, rec.tau, atol=1e-12)  # type: ignore[arg-type]
    assert np.allclose(back.q, rec.q + [0, 0.25], atol=1e-12)
    assert (back.robot, back.joints, back.rate_hz, back.torque_sensor) == ("iiwa14", JOINTS, 500.0, "motor")
    assert (back.noise, back.motion, back.control.mode) == ({"tau": 0.1}, "sines", "unknown")
    with pytest.raises(UserError, match="exists"):
        args.run()


@pytest.mark.parametrize("table", ["csv", "parquet"])
def test_the_projects_own_columns_need_no_map(tmp_path, table):
    rec = recording(60)
    folder = write(rec, tmp_path / "r", table=table)
    back = import_table(folder / f"samples.{table}", "iiwa14", JOINTS)
    for name in ("time", "q", "dq", "tau", "tau_cmd", "q_cmd", "ee", "ee_cmd", "ft"):
        assert getattr(back, name).tobytes() == getattr(rec, name).tobytes(), name


def test_dates_become_seconds_from_the_first_sample(tmp_path):
    rows = [f"{1_700_000_000_000_000_000 + 2_000_000 * k},{0.01 * k},{0.02 * k}" for k in range(50)]
    (tmp_path / "log.csv").write_text("\n".join(["time,q.joint1,q.joint2", *rows]))
    (tmp_path / "map.yaml").write_text("time: {column: time, unit: ns}\n")
    rec = import_table(tmp_path / "log.csv", "iiwa14", JOINTS, read_map(tmp_path / "map.yaml", JOINTS))
    assert rec.time[0] == 0 and np.allclose(rec.time, 0.002 * np.arange(50), atol=1e-6)


def test_an_archive(tmp_path):
    rec = recording(80, episode=np.arange(80) // 40)
    names = ("time", "q", "tau", "q_cmd", "ee", "ft", "episode")
    arrays = {name: getattr(rec, name) for name in names}
    np.savez(tmp_path / "run.npz", joints=np.array(JOINTS), **arrays)
    back = import_npz(tmp_path / "run.npz", "iiwa14", ("a", "b", "c"))
    assert back.joints == JOINTS and all(np.array_equal(getattr(back, n), getattr(rec, n)) for n in names)
    np.savez(tmp_path / "other.npz", t=1e3 * rec.time, positions=np.rad2deg(rec.q))
    (tmp_path / "map.yaml").write_text("time: {column: t, unit: ms}\nq: {column: positions, unit: deg}\n")
    back = import_npz(tmp_path / "other.npz", "iiwa14", JOINTS, read_map(tmp_path / "map.yaml", JOINTS))
    assert np.allclose(back.q, rec.q, atol=1e-13) and np.allclose(back.time, rec.time, atol=1e-13)


def save_npz(file, **arrays):
    time = np.arange(10) / 100
    np.savez(file, **({"time": time, "q": np.zeros((10, 2))} | arrays))


BAD_ARCHIVES = {
    "Python objects": (lambda f: save_npz(f, q=np.array([[{}] * 2] * 10, dtype=object)), "Python objects"),
    "text": (lambda f: save_npz(f, q=np.array([["a", "b"]] * 10)), "numeric"),
    "another shape": (lambda f: save_npz(f, q=np.zeros((10, 3))), r"expected \(10, 2\)"),
    "another length": (lambda f: save_npz(f, tau=np.zeros((9, 2))), "tau"),
    "a scalar": (lambda f: save_npz(f, time=np.array(1.0)), r"expected \(1, 2\)"),
    "no angles": (lambda f: np.savez(f, time=np.arange(3.0)), "choices: time"),
    "no archive": (lambda f: f.write_bytes(b"PK\x03\x04 nothing"), "archive"),
    "empty": (lambda f: f.write_bytes(b""), "archive"),
}


@pytest.mark.parametrize("case", BAD_ARCHIVES)
def test_bad_archives(tmp_path, case):
    make, words = BAD_ARCHIVES[case]
    make(tmp_path / "run.npz")
    with pytest.raises(UserError, match=words):
        import_npz(tmp_path / "run.npz", "iiwa14", JOINTS, ColumnMap())


BAD_MAPS = {
    "q.joint9: a": "choices: .*q.joint1",
    "q.joint1: {column: a, unit: degrees}": "unknown unit.*choices: .*deg",
    "q.joint1: {column: a, unit: [deg]}": "unknown unit",
    "q.joint1: {columns: a}": "says no column",
    "q.joint1: {column: a, scale: big}": "q.joint1.scale",
    "q.joint1: 1.5": "says no column",
    "[a]": "mapping",
    "joints: {joint9: a}": "joint9",
    "recording: 3": "recording",
}


@pytest.mark.parametrize("text", BAD_MAPS)
def test_bad_maps(tmp_path, text):
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(UserError, match=BAD_MAPS[text]):
        read_map(tmp_path / "map.yaml", JOINTS)


def test_what_cannot_be_converted(tmp_path):
    (tmp_path / "log.csv").write_text("time,pos\n0,1\n0.1,2\n")
    for source, words in (("log.csv", "q.joint1"), ("gone.csv", "exist"), (".", "convert"), ("log.xlsx", "convert")):
        (tmp_path / "log.xlsx").touch()
        with pytest.raises(UserError, match=words):
            Args(tmp_path / source, tmp_path / "out", "iiwa14").run()
    with pytest.raises(UserError, match="--topic is for bags"):
        Args(tmp_path / "log.csv", tmp_path / "out", "iiwa14", topic="/a").run()
    assert not (tmp_path / "out").exists()
