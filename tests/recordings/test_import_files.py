"""Tables and NumPy archives of any naming become the same recording."""

from __future__ import annotations

import gzip
import os
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made import recording
from typed import convert

from vispeg.api.recording.convert import convert as convert_file
from vispeg.core.errors import UserError
from vispeg.formats.yaml_data import parse_yaml
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.importers.guess import words as said_of
from vispeg.recordings.importers.guess.source import dialect_of, guess
from vispeg.recordings.importers.mapping import ColumnMap, map_from, read_map
from vispeg.recordings.importers.npz import import_npz
from vispeg.recordings.importers.plausible import doubts
from vispeg.recordings.importers.source import read_source
from vispeg.recordings.importers.table import import_table
from vispeg.recordings.load import load
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Reading
from vispeg.recordings.write import write

pytestmark = pytest.mark.filterwarnings("ignore:.*torque_sensor", "ignore:.*unknown")
JOINTS = ("joint1", "joint2")


def test_a_table_in_degrees_and_milliseconds(tmp_path):
    rec = recording(100)
    degrees = np.rad2deg(rec.q)
    lines = ["t_ms,pos_1,pos_2,load_1,load_2,state"]
    lines += [
        f"{1e3 * t!r},{a!r},{-b!r},{c!r},{d!r},ok"
        for t, (a, b), (c, d) in zip(rec.time.tolist(), degrees.tolist(), (1e3 * rec.tau).tolist(), strict=True)
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
    args = tmp_path / "log.csv", "iiwa14", out
    options = {"map": tmp_path / "map.yaml", "torque_sensor": "motor"}
    assert convert(*args, **options) == 0
    back = load(out)
    assert np.allclose(back.time, rec.time, atol=1e-12) and np.allclose(back.tau, rec.tau, atol=1e-12)
    assert np.allclose(back.q, rec.q + [0, 0.25], atol=1e-12)
    assert (back.robot, back.joints, back.rate_hz, back.torque_sensor) == ("iiwa14", JOINTS, 500.0, "motor")
    assert (back.noise, back.motion, back.control.mode) == ({"tau": 0.1}, "sines", "unknown")
    with pytest.raises(UserError, match="exists"):
        convert(*args, **options)


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


def test_a_map_of_an_archives_time_alone_leaves_the_others_their_names(tmp_path):
    """One that names the angles leaves nothing else to its name. Arrays named as columns are a table's still."""
    rec = recording(80)
    np.savez(tmp_path / "run.npz", t=1e3 * rec.time, q=rec.q, tau=rec.tau)
    np.savez(tmp_path / "table.npz", t=1e3 * rec.time, **{f"q.{name}": rec.q[:, j] for j, name in enumerate(JOINTS)})
    said = {"time": {"column": "t", "unit": "ms"}}
    for name, more in (("run", {"q": "q"}), ("run", {}), ("table", {})):
        back = read_source(tmp_path / f"{name}.npz", "iiwa14", JOINTS, map_from(said | more, tmp_path, JOINTS))
        assert np.array_equal(back.q, rec.q) and np.allclose(back.time, rec.time, atol=1e-13)
        assert (back.tau is not None) == (name == "run" and not more)


@pytest.mark.parametrize("form", ["csv", "parquet", "npz"])
def test_what_a_map_of_the_angles_leaves_out_is_not_read_whatever_its_name(tmp_path, form):
    """A counter called `episode` that is none, torques in another unit, a tool's pose: only the time needs no line."""
    rec = recording(60, episode=np.arange(60) // 30)
    if form == "npz":
        file, said = tmp_path / "run.npz", {"q": "q", "dq": "speed"}
        np.savez(file, time=rec.time, q=rec.q, speed=rec.dq, tau=rec.tau, ee=rec.ee, episode=rec.episode)
    else:
        file = write(rec, tmp_path / "r", table=form) / f"samples.{form}"
        said = {f"{signal}.{joint}": f"{signal}.{joint}" for signal in ("q", "dq") for joint in JOINTS}
    back = read_source(file, "iiwa14", JOINTS, map_from(said, tmp_path, JOINTS))
    assert np.array_equal(back.time, rec.time) and np.array_equal(back.q, rec.q) and np.array_equal(back.dq, rec.dq)
    assert all(getattr(back, left_out) is None for left_out in ("episode", "tau", "tau_cmd", "q_cmd", "ee", "ft"))


def test_a_guess_reads_what_it_says_that_it_uses_and_nothing_else(tmp_path):
    """Of a log with a recording's own names: pose and wrench are used, a counter with fractions is not."""
    rec = recording(60)
    file = write(rec, tmp_path / "r") / "samples.csv"
    head, *rows = file.read_text().splitlines()
    file.write_text("\n".join([f"{head},episode", *(f"{row},{k / 7}" for k, row in enumerate(rows)), ""]))
    found = guess(file, JOINTS, Limits(np.full((2, 2), [-7.0, 7.0]), np.full(2, np.inf), np.full(2, np.inf)))
    back = import_table(file, "iiwa14", JOINTS, map_from(said_of.data(found), file, JOINTS))
    assert set(found.unused) == {"episode"} and back.episode is None
    for name in ("q", "tau", "ee", "ee_cmd", "ft"):
        assert np.array_equal(getattr(back, name), getattr(rec, name)), name


def test_the_parts_of_an_array_add_up(tmp_path):
    """As in a table: a stamp in two parts, angles and their offset. What names no whole array is refused."""
    rec = recording(80)
    ticks = np.round(1e9 * rec.time).astype(np.int64) + 1_700_000_000_900_000_000
    stamp = {"sec": ticks // 10**9, "nsec": ticks % 10**9}
    np.savez(
        tmp_path / "run.npz", **stamp, p=np.rad2deg(rec.q - 0.3), o=np.full((80, 2), 0.3), tau=rec.tau, t1=rec.tau[:, 0]
    )
    lines = "time: {column: sec, plus: {column: nsec, unit: ns}}\nq: {column: p, unit: deg, plus: o}\n"
    back = import_npz(tmp_path / "run.npz", "iiwa14", JOINTS, map_from(parse_yaml(lines, tmp_path), tmp_path, JOINTS))
    assert np.allclose(back.time, rec.time, atol=1e-6) and np.allclose(back.q, rec.q, atol=1e-12)
    mixed = map_from(parse_yaml(lines + "tau.joint1: t1\n", tmp_path), tmp_path / "map.yaml", JOINTS)
    with pytest.raises(UserError, match="tau.joint1: names no whole array"):
        import_npz(tmp_path / "run.npz", "iiwa14", JOINTS, mixed)
    for plus, words in (("oo", "no such array"), ("sec", "wrong shape")):
        bad = map_from(parse_yaml(lines.replace("plus: o", f"plus: {plus}"), tmp_path), tmp_path, JOINTS)
        with pytest.raises(UserError, match=words):
            import_npz(tmp_path / "run.npz", "iiwa14", JOINTS, bad)


def test_an_archive_without_times_takes_the_stated_rate(tmp_path):
    rec = recording(80, episode=np.arange(80) // 40)
    np.savez(tmp_path / "run.npz", q=rec.q, episode=rec.episode)
    back = import_npz(tmp_path / "run.npz", "iiwa14", JOINTS, ColumnMap(rate_hz=50.0))
    assert np.allclose(back.time, np.tile(np.arange(40) / 50, 2)) and back.rate_hz == 50


def test_a_stated_rate_counts_before_the_file_s_own_time_and_never_beside_the_map_s(tmp_path):
    rec = recording(60)
    folder = write(rec, tmp_path / "r")
    np.savez(tmp_path / "run.npz", q=rec.q, time=rec.time)
    out, two = tmp_path / "out", ColumnMap(recording={"joints": list(JOINTS)})
    for file in (folder / "samples.csv", tmp_path / "run.npz"):
        with pytest.warns(UserWarning, match=f"{file}: its `time` is not used: 50 samples a second are stated"):
            back = convert_file(file, "iiwa14", out, mapping=two, rate_hz=50, overwrite=True)
        assert np.allclose(back.time, np.arange(60) / 50)
    for time in ("time", "{rate_hz: 100}"):
        (tmp_path / "map.yaml").write_text(f"time: {time}\n")
        with pytest.raises(UserError, match="map.yaml: rate_hz: the map states the time too"):
            convert_file(folder / "samples.csv", "iiwa14", tmp_path / "new", mapping=tmp_path / "map.yaml", rate_hz=50)
    assert not (tmp_path / "new").exists()


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
    "q.joint1: {column: a, unit: rpm}": "q.joint1: is no unit of this signal; got 'rpm'; choices: rad, mrad, deg",
    "time: {column: a, plus: {column: b, unit: mm}}": "is no unit of this signal.*choices: s, ms, us, ns",
    "q.joint1: {columns: a}": "names no column",
    "q.joint1: {column: a, scale: big}": "q.joint1.scale",
    "q.joint1: 1.5": "names no column",
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
            convert(tmp_path / source, "iiwa14", tmp_path / "out")
    with pytest.raises(UserError, match="topic is for bags"):
        convert(tmp_path / "log.csv", "iiwa14", tmp_path / "out", topic="/a")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("tau.joint1: u", "map.yaml: tau.joint2: is missing; .*`tau.joint2: none`"),
        ("recording: {joints: [joint1, joint2, joint3]}", "map.yaml: q.joint3: is missing; .*joints: "),
    ],
)
def test_a_map_that_forgets_a_joint_is_named_not_the_log(tmp_path, lines, words):
    (tmp_path / "map.yaml").write_text(
        f"time: t\nq.joint1: a\nq.joint2: b\n{lines}\n" + "recording: {joints: [joint1, joint2]}\n" * ("u" in lines)
    )
    (tmp_path / "log.csv").write_text("t,a,b,u\n0,1,2,3\n0.1,1,2,3\n0.2,1,2,3\n")
    with pytest.raises(UserError, match=words):
        convert(tmp_path / "log.csv", "iiwa14", tmp_path / "out", map=tmp_path / "map.yaml")
    assert not (tmp_path / "out").exists()


def test_a_missing_time_is_named_by_its_own_column(tmp_path):
    (tmp_path / "map.yaml").write_text("time: {column: t_ms, unit: ms}\nq.joint1: a\nrecording: {joints: [joint1]}\n")
    (tmp_path / "log.csv").write_text("t_ms,a\n0,1\n,1\n20,1\n30,1\n")
    with pytest.raises(UserError, match=r"row 3, column t_ms \(time\): is missing"):
        convert(tmp_path / "log.csv", "iiwa14", tmp_path / "out", map=tmp_path / "map.yaml")


@pytest.mark.parametrize("guessed", [False, True])
def test_a_recording_is_no_log(guessed, tmp_path):
    """Its controller, tool and noise would be lost."""
    write(recording(20), tmp_path / "rig")
    with pytest.raises(UserError, match="rig: is a recording already"):
        convert(tmp_path / "rig", "iiwa14", tmp_path / "out", guess=guessed)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("kind", ["csv", "csv.gz", "parquet", "npz", "bag", "db3", "mcap"])
def test_a_pipe_is_no_log(tmp_path, kind):
    os.mkfifo(tmp_path / f"log.{kind}")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("{}")
    os.mkfifo(tmp_path / "bag" / "run.mcap")
    for source in (tmp_path / f"log.{kind}", tmp_path / "bag"):
        with pytest.raises(UserError, match="is not a regular file"):
            convert(source, "iiwa14", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("guessed", [False, True])
def test_a_pipe_is_no_table(tmp_path, guessed):
    os.mkfifo(tmp_path / "log.parquet")
    with pytest.raises(UserError, match="is not a regular file"):
        convert(tmp_path / "log.parquet", "iiwa14", tmp_path / "out", guess=guessed)
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(UserError, match="folder.csv"):
        convert(tmp_path / "folder.csv", "iiwa14", tmp_path / "out", guess=guessed)


def rolled(seconds=2.0, rate=200.0):
    """Two joints that move as an arm does: time s, q rad, dq rad/s, tau N m."""
    time = np.arange(round(seconds * rate)) / rate
    q = np.stack([0.8 * np.sin(3 * time), 0.5 * np.cos(2 * time)], 1)
    return time, q, np.gradient(q, time, axis=0), 20 * np.cos(q)


UNITS = {  # factors on time, q, dq, tau as they are in the file; the units that a map states; what has to be said
    "milliseconds for seconds": ((1e3, 1, None, None), {}, "samples a second.*likely ms where s was taken"),
    "seconds for milliseconds": ((1, 1, None, None), {"time": "ms"}, "2e.05 samples.*likely s where ms was taken"),
    "ms for s, at 8 kHz": ((1e3, 1, None, None), {}, "never faster than .*ms for s"),
    "s for ms, slowly logged": (
        (25, 1, None, None),
        {"time": "ms"},
        "times as fast as they can be.*longer unit of time",
    ),
    "degrees for radians": ((1, 8, None, None), {}, "outside the joints' ranges.*likely deg"),
    "radians for degrees": ((1, 1, None, None), {"q": "deg"}, "no angle is larger than.*likely rad, not deg"),
    "small degrees, by the speeds": (
        (1, 2 / 0.8, 1, None),
        {"dq": "deg/s"},
        "measured speeds are .* times the change of the angles",
    ),
    "milliseconds, by the speeds": ((1e3 / 50, 1, 1, None), {}, "measured speeds are"),
    "millinewton metres": ((1, 1, None, 1e3), {}, "torques are up to .*likely mNm"),
}


@pytest.mark.parametrize("case", UNITS)
def test_a_unit_that_cannot_be_true_is_refused_and_can_be_insisted_on(tmp_path, case):
    factors, units, words = UNITS[case]
    made = rolled(2.0, 8000.0 if "8 kHz" in case else 200.0)
    arrays = dict(zip(("time", "q", "dq", "tau"), made, strict=True))
    columns = {}
    for (name, values), factor in zip(arrays.items(), factors, strict=True):
        if factor is not None:
            columns |= {name: factor * values} if name == "time" else {
                f"{name}.joint{j + 1}": factor * values[:, j] for j in range(2)
            }  # fmt: skip
    rows = np.stack(list(columns.values()), 1).tolist()
    (tmp_path / "log.csv").write_text(
        "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n"
    )
    lines = [f"{c}: {{column: {c}, unit: {units[c.split('.')[0]]}}}" for c in columns if c.split(".")[0] in units]
    (tmp_path / "map.yaml").write_text("\n".join([*lines, "recording: {joints: [joint1, joint2]}"]))
    given = {"map": tmp_path / "map.yaml", "torque_sensor": "joint"}
    with pytest.raises(UserError, match=f"a unit cannot be true: .*{words}.*insist"):
        convert(tmp_path / "log.csv", "iiwa14", tmp_path / "out", **given)
    assert not (tmp_path / "out").exists()
    assert convert(tmp_path / "log.csv", "iiwa14", tmp_path / "out", insist=True, **given) == 0


@pytest.mark.parametrize("rate", [10.0, 50.0, 8000.0])
def test_units_that_can_be_true_pass(rate):
    time, q, dq, tau = rolled(4.0, rate)
    limits = Limits(np.full((2, 2), [-3.0, 3.0]), np.full(2, 1.5), np.full(2, 100.0))
    unknown = Limits(np.full((2, 2), [-np.inf, np.inf]), np.full(2, np.inf), np.full(2, np.inf))
    rec = recording(len(time), rate, time=time, q=q, dq=dq, tau=tau)
    for known in (limits, unknown):
        assert doubts(rec, known) == []
        assert doubts(replace(rec, q=np.zeros_like(q), dq=np.zeros_like(q)), known) == []  # a robot at rest
        assert doubts(replace(rec, q=0.02 * q + [0.4, -1], dq=None), known) == []  # small motion


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32"])
@pytest.mark.parametrize("packed", [False, True])
def test_a_byte_order_mark_says_how_the_text_is_encoded(tmp_path, encoding, packed):
    """Excel's "Unicode text": UTF-16, tabs, decimal commas; umlauts and the degree sign in the names."""
    rec = recording(30, rate_hz=100.0)
    names = ["Zeit [s]", "Gelenk 1 [°]", "Gelenk 2 [°]"]
    rows = ["\t".join(repr(x).replace(".", ",") for x in row) for row in np.c_[rec.time, np.degrees(rec.q)].tolist()]
    file = tmp_path / ("log.csv.gz" if packed else "log.csv")
    data = "\r\n".join(["\t".join(names), *rows, ""]).encode(encoding)
    file.write_bytes(gzip.compress(data) if packed else data)
    found = guess(file, JOINTS, Limits(np.full((2, 2), [-7.0, 7.0]), np.full(2, np.inf), np.full(2, np.inf)))
    mapping = map_from(said_of.data(found), file, JOINTS)
    back = import_table(file, "iiwa14", JOINTS, mapping)
    np.testing.assert_allclose(back.q, rec.q, atol=1e-12)
    file.write_bytes(gzip.compress(data[:-7]) if packed else data[:-7])  # within the last number
    assert len(import_table(file, "iiwa14", JOINTS, mapping).time) == 30


@pytest.mark.parametrize("first", ["11,5", "1,5", "-11,5"])
def test_a_decimal_comma_is_no_time_of_day(tmp_path, first):
    """ISO 8601 knows `11,5` as half a second past eleven."""
    (tmp_path / "log.csv").write_text(f"time;angle\n0,0;{first}\n0,1;2,25\n")
    table = read_table(tmp_path / "log.csv", Reading(dialect=dialect_of(tmp_path / "log.csv", ())))
    assert table.number("angle").tolist() == [float(first.replace(",", ".")), 2.25] and not table.dates


@pytest.mark.parametrize("packed", [False, True])
def test_a_table_in_latin_1_says_how_to_convert_it(tmp_path, packed):
    """Of a header in another encoding, and of a cell far down."""
    text, file = "time,Gelenk 1 [°]\n0,1\n0.1,2\n".encode("latin-1"), tmp_path / f"log 1.csv{'.gz' * packed}"
    for data in (text, text.replace(b"\xb0", b"") + b"0.2,\xb0\n"):
        file.write_bytes(gzip.compress(data) if packed else data)
        for read in (partial(read_table, file, Reading()), partial(dialect_of, file, ())):
            with pytest.raises(UserError, match="is not UTF-8 text.*iconv -f CP1252 -t UTF-8 'log 1.csv"):
                read()


@pytest.mark.parametrize("separator, decimal", [(";", ","), ("\t", "."), (" ", "."), (",", ".")])
def test_a_map_says_how_a_table_is_written(tmp_path, separator, decimal):
    rec = recording(30, rate_hz=100.0)
    rows = [separator.join(repr(x).replace(".", decimal) for x in row) for row in np.c_[rec.time, rec.q].tolist()]
    (tmp_path / "log.csv").write_text("\r\n".join([separator.join(["time", "q.joint1", "q.joint2"]), *rows, ""]))
    (tmp_path / "map.yaml").write_text(
        f"table: {{separator: {separator!r}, decimal: '{decimal}'}}".replace("\\t", "\t")
    )
    back = import_table(tmp_path / "log.csv", "iiwa14", JOINTS, read_map(tmp_path / "map.yaml", JOINTS))
    assert np.array_equal(back.q, rec.q) and np.array_equal(back.time, rec.time)


SNIPPETS = [
    b"",
    b"\n",
    b",",
    b";",
    b"nan",
    b"1e999",
    b"-",
    b"\xff",
    b"\0",
    b'"',
    b"&a",
    b"*a",
    b"[",
    b"{",
    b": ",
    b"!!",
    b"table: ",
]
edits = st.lists(
    st.tuples(st.integers(0, 2), st.floats(0, 1), st.integers(0, 40), st.sampled_from(SNIPPETS)), min_size=1, max_size=4
)


@pytest.fixture(scope="module")
def material(tmp_path_factory):
    """A table, a map for it and an archive."""
    root = tmp_path_factory.mktemp("fuzz")
    rec = recording(12, ee=None, ee_cmd=None, ft=None, tau_cmd=None, dq=None)
    table = (write(rec, root / "r") / "samples.csv").read_bytes()
    text = b"time: {column: time, unit: s}\nq.joint1: {column: q.joint1, unit: rad, scale: 1.0}\n"
    text += b"recording: {joints: [joint1, joint2], torque_sensor: joint}\ntable: {separator: ',', decimal: '.'}\n"
    np.savez(root / "run.npz", time=rec.time, q=rec.q, tau=rec.tau)
    return root, table, text, (root / "run.npz").read_bytes()


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(edits=edits, way=st.sampled_from(["map", "guess", "npz", "gz"]))
def test_every_damaged_source_or_map_gives_a_recording_or_a_user_error(material, edits, way):
    root, *parts = material
    for which, place, drop, put in edits:
        at = int(place * len(parts[which]))
        parts[which] = parts[which][:at] + put + parts[which][at + drop :]
    table, text, archive = parts
    name = {"npz": "run.npz", "gz": "log.csv.gz"}.get(way, "log.csv")
    packed = gzip.compress(table)
    data = {"npz": archive, "gz": packed[: len(packed) - edits[0][2] // 10]}.get(way, table)
    (root / name).write_bytes(data)
    (root / "map.yaml").write_bytes(text)
    limits = Limits(np.full((2, 2), [-3.0, 3.0]), np.full(2, 1.5), np.full(2, 100.0))
    try:
        if way == "guess":
            proposal = guess(root / name, JOINTS, limits)
            mapping = map_from(parse_yaml(said_of.text(proposal), "map"), root / name, JOINTS)
            assert said_of.advice(proposal)
        else:
            mapping = read_map(root / "map.yaml", JOINTS)
        load_it = import_npz if way == "npz" else import_table
        rec = load_it(root / name, "iiwa14", JOINTS, mapping)
        doubts(
            rec,
            Limits(
                *(
                    np.concatenate([part] * 8)[: len(rec.joints)]
                    for part in (limits.range, limits.velocity, limits.torque)
                )
            ),
        )
    except UserError as error:
        assert "\n" not in str(error)
    else:
        assert rec.q.shape == (len(rec.time), len(rec.joints))
