"""A recording that would mislead is refused in one line that names the place."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made import recording

from vispeg.core.errors import UserError
from vispeg.recordings.cell import WrenchSensor
from vispeg.recordings.load import load
from vispeg.recordings.recording import Recording
from vispeg.recordings.write import write


@pytest.fixture
def folder(tmp_path):
    return write(recording(40, ee=None, ee_cmd=None, ft=None, dq=None, tau_cmd=None), tmp_path / "r")


def edit(folder, change):
    file = folder / "recording.yaml"
    data = yaml.safe_load(file.read_text())
    change(data)
    file.write_text(yaml.safe_dump(data))


def cell(folder, row, column, text):
    """Replaces a cell; `row` as the message counts it (2 is the first sample)."""
    file = folder / "samples.csv"
    lines = [line.split(",") for line in file.read_text().splitlines()]
    lines[row - 1][lines[0].index(column)] = text
    file.write_text("\n".join(map(",".join, lines)) + "\n")


def refused(folder, *words):
    with pytest.raises(UserError) as error:
        load(folder)
    said = str(error.value)
    assert "\n" not in said
    for word in words:
        assert word in said, said


HEADERS = {
    "other version": (lambda d: d.update(format="vispeg-recording/2"), "format", "vispeg-recording/1"),
    "no joints": (lambda d: d.pop("joints"), "joints", "missing"),
    "joint twice": (lambda d: d.update(joints=["joint1", "joint1"]), "joints", "twice", "joint1"),
    "joint is a number": (lambda d: d.update(joints=[1, 2]), "joints[0]", "text"),
    "unknown mode": (lambda d: d["control"].update(mode="positon"), "control.mode", "did you mean 'position'"),
    "short gains": (lambda d: d["control"].update(kp=[1.0]), "control.kp", "expected 2", "got 1"),
    "no gains": (lambda d: d["control"].pop("kd"), "control.kd", "missing"),
    "negative gain": (lambda d: d["control"].update(kp=[1.0, -1.0]), "control.kp[1]"),
    "negative noise": (lambda d: d.update(noise={"q": -1e-5}), "noise.q"),
    "no noise at all": (lambda d: d.update(noise={"q": 0}), "noise.q"),
    "infinite rate": (lambda d: d.update(rate_hz=float("inf")), "rate_hz"),
    "no robot file": (lambda d: d.update(robot="gone.urdf"), "robot", "gone.urdf"),
    "tilt of three": (lambda d: d.update(base={"tilt_rad": [0, 0, 0]}), "base.tilt_rad"),
    "tilt in degrees": (lambda d: d.update(base={"tilt_rad": [0, 30]}), "base.tilt_rad[1]"),
    "tool by word": (lambda d: d.update(tool="hammer"), "tool", "mapping"),
    "rate by word": (lambda d: d.update(rate_hz="fast"), "rate_hz", "expected a number"),
    "columns for other joints": (lambda d: d.update(joints=["joint1", "elbow"]), "samples.csv", "q.elbow", "q.joint1"),
    "command missing": (lambda d: d["control"].update(mode="torque"), "torque", "tau_cmd.joint1"),
}


@pytest.mark.parametrize("case", HEADERS)
def test_header(folder, case):
    change, *words = HEADERS[case]
    edit(folder, change)
    refused(folder, *words)


CELLS = {
    "word": ((7, "q.joint2", "abc"), "row 7", "q.joint2", "abc"),
    "infinite": ((7, "q.joint2", "inf"), "row 7", "q.joint2"),
    "degrees": ((9, "q.joint1", "45.0"), "row 9", "q.joint1", "degrees"),
    "time stands still": ((5, "time", "0.004"), "row 5", "time", "increase"),
    "time missing": ((5, "time", ""), "row 5", "time"),
    "decimal comma": ((5, "q.joint1", '"0,5"'), "row 5", "decimal comma", "expected a decimal point (0.5)"),
    "underscore is no digit": ((5, "q.joint1", "1_0"), "row 5", "1_0"),
}


@pytest.mark.parametrize("case", CELLS)
def test_cell(folder, case):
    place, *words = CELLS[case]
    cell(folder, *place)
    refused(folder, *words)


def commas(text):
    """The samples, not the header, with decimal commas."""
    head, _, body = text.partition("\n")
    return head + "\n" + body.replace(".", ",")


TEXTS = {
    "cut off": (lambda t: t[: t.rindex(",")], "row 41", "expected 7", "got 6"),
    "empty": (lambda t: "", "samples.csv", "empty"),
    "header only": (lambda t: t.split("\n")[0] + "\n", "no samples"),
    "column twice": (lambda t: t.replace("q.joint2", "q.joint1", 1), "q.joint1", "twice"),
    "semicolons": (lambda t: t.replace(",", ";"), "samples.csv", "expected ','", 'separator: ";"'),
    "a German spreadsheet": (lambda t: commas(t.replace(",", ";")), "semicolons", "decimal commas", 'decimal: ","'),
    "commas for points": (lambda t: commas(t), "row 2", "decimal commas", "write 1.5, not 1,5"),
    "tabs": (lambda t: t.replace(",", "\t"), "expected ','"),
    "binary": (lambda t: "\ud800", "UTF-8"),
}


@pytest.mark.parametrize("case", TEXTS)
def test_table(folder, case):
    change, *words = TEXTS[case]
    file = folder / "samples.csv"
    file.write_bytes(change(file.read_text()).encode("utf-8", "surrogatepass"))
    refused(folder, *words)


YAMLS = {
    "a list": "- 1\n- 2\n",
    "empty": "",
    "python tag": "format: !!python/object/apply:os.system ['true']\n",
    "bomb": "a: &a [1,1,1,1,1,1,1,1,1]\n" + "".join(
        f"{n}: &{n} [{','.join(['*' + p] * 9)}]\n" for p, n in zip("abcdefg", "bcdefgh", strict=True)),
    "cycle": "a: &a [*a]\n",
    "deep": "[" * 50_000,
    "key twice": "robot: a\nrobot: b\n",
    "tab": "a:\n\t- 1\n",
    "date that is none": "format: 2024-99-99\n",
    "long number": "rate_hz: " + "9" * 6000,
}  # fmt: skip


@pytest.mark.parametrize("case", YAMLS)
def test_yaml(folder, case):
    (folder / "recording.yaml").write_text(YAMLS[case])
    refused(folder, "recording.yaml")


@pytest.mark.parametrize("factor, unit", [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
def test_time_in_another_unit(tmp_path, factor, unit):
    rec = recording(40)
    rec.time[:] *= factor
    refused(write(rec, tmp_path / "r"), "time", unit)


def test_quaternion_in_another_order_is_no_unit_quaternion(tmp_path):
    rec = recording(40)
    rec.ee[11, 3:] *= 1.2
    refused(write(rec, tmp_path / "r"), "row 13", "ee.qw")


def test_episodes_restart_time_but_do_not_resume(tmp_path):
    time = np.tile(np.arange(20) / 500, 2)
    whole = recording(40, time=time, episode=np.repeat([3, 1], 20))
    assert load(write(whole, tmp_path / "whole")).episode.tolist() == [3] * 20 + [1] * 20
    refused(write(recording(40, time=time), tmp_path / "none"), "row 22", "episode")
    torn = recording(40, episode=np.repeat([0, 1, 0, 2], 10))
    refused(write(torn, tmp_path / "torn"), "row 22", "episode")


@pytest.mark.parametrize("signal, column", [("q", "q.joint1"), ("q_cmd", "q_cmd.joint1"), ("ft", "ft.fx")])
def test_a_fifth_may_be_missing_but_no_more(tmp_path, signal, column):
    """The line names the column, the share and the rows of the longest gap, as the file counts them."""
    rec = recording(40, wrench=WrenchSensor())
    values = getattr(rec, signal).copy()
    values[10:18, 0] = np.nan
    back = load(write(replace(rec, **{signal: values}), tmp_path / "fifth"))
    assert np.isnan(getattr(back, signal)[:, 0]).sum() == 8
    values[30, 0] = np.nan
    refused(write(replace(rec, **{signal: values}), tmp_path / "more"), f"column {column}", "22.5%", "row 12 to row 19")


def test_what_is_unknown_is_named_once_and_does_no_harm(folder):
    edit(folder, lambda d: (d.update(colour="red"), d["control"].update(kpp=3)))
    file = folder / "samples.csv"
    lines = file.read_text().splitlines()
    file.write_text("\n".join([lines[0] + ",status,q.joint9", *(line + ",OK,1" for line in lines[1:])]))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        rec = load(folder)
    said = [str(w.message) for w in caught]
    assert len(said) == 2 and rec.joints == ("joint1", "joint2")
    assert "colour, control.kpp" in said[0] and re.search(r"status, q\.joint9$", said[1])


@pytest.mark.parametrize("path", ["gone", "\0", "x" * 5000, "r/samples.csv"])
def test_paths_that_are_no_folder(folder, path):
    refused(folder.parent / path)


def test_two_tables_or_none(folder):
    (folder / "samples.parquet").write_bytes(b"PAR1")
    refused(folder, "both")
    (folder / "samples.csv").unlink()
    refused(folder, "Parquet")
    (folder / "samples.parquet").unlink()
    refused(folder, "samples.csv")


@pytest.fixture(scope="module")
def material(tmp_path_factory):
    root = tmp_path_factory.mktemp("fuzz")
    rec = recording(12, ee_cmd=None, ft=None, tau_cmd=None, tool={"mass_kg": 1.0})
    both = [write(rec, root / table, table=table) for table in ("csv", "parquet")]
    return root, [(f.name, (f / "recording.yaml").read_bytes(), (f / f"samples.{f.name}").read_bytes()) for f in both]


SNIPPETS = [
    *(b"", b"\n", b",", b"nan", b"1e999", b"-", b"\xff", b"\0", b'"', b"&a", b"*a", b"[", b"{", b"}", b": ", b"!!"),
    *(b"null", b"<<: *a", b"none", b"9" * 30, b"0x", b"'", b"#", b"\r", b"\xef\xbb\xbf", b"- ", b"1:2:3", b"?"),
]
edits = st.lists(
    st.tuples(st.booleans(), st.floats(0, 1), st.integers(0, 40), st.sampled_from(SNIPPETS)), min_size=1, max_size=4
)


@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(which=st.integers(0, 1), edits=edits)
@pytest.mark.filterwarnings("ignore")
def test_every_damaged_file_gives_a_recording_or_a_user_error(material, which, edits):
    root, sources = material
    kind, header, samples = sources[which]
    parts = [header, samples]
    for in_samples, place, drop, put in edits:
        old = parts[in_samples]
        at = int(place * len(old))
        parts[in_samples] = old[:at] + put + old[at + drop :]
    folder = root / "damaged"
    folder.mkdir(exist_ok=True)
    for file in folder.iterdir():
        file.unlink()
    (folder / "recording.yaml").write_bytes(parts[0])
    (folder / f"samples.{kind}").write_bytes(parts[1])
    try:
        rec = load(folder)
    except UserError as error:
        assert "\n" not in str(error)
    else:
        assert isinstance(rec, Recording) and rec.q.shape == (len(rec.time), len(rec.joints))
