"""The guarded readers: every limit ends in one line, before anything is built, and what keeps to them comes through."""

import os
import re
import time
from itertools import pairwise
from pathlib import Path

import pytest
import yaml

import vispeg
from vispeg.core.errors import UserError
from vispeg.formats.format import Format
from vispeg.formats.guard import read_bytes
from vispeg.formats.json_data import parse_json, read_json
from vispeg.formats.xml_tree import read_xml
from vispeg.formats.yaml_data import parse_yaml, read_yaml

TEN = ", ".join(["*{0}"] * 10)
BOMB = "a: &a [1, 2]\n" + "".join(f"{c}: &{c} [{TEN.format(b)}]\n" for b, c in pairwise("abcdefghij"))
ROOT = Path(vispeg.__file__).parent
XML_BOMB = '<!DOCTYPE x [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><x>&b;</x>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (BOMB, "too many values"),
        ("a: &a [*a]", "refers to itself"),
        ("a: *b", "without its anchor"),
        ("[" * 100_000, "nested too deeply"),
        ("- " * 100_000, "nested too deeply"),
        ("x: " + "9" * 1000, "too many digits"),
        ("x: 1" + ":59" * 20_000, "too many digits"),
        ("a: 1\nb: 2\na: 3", "line 3: 'a' is given twice"),
        ("x: .nan", "x: is not finite"),
        ("x: [0, {y: -.inf}]", "x[1].y: is not finite"),
        ('x: "\\0"', "not text"),
        ("x: !!python/object/apply:os.system [id]", "a tag beyond plain data"),
        ("x: !!binary aGk=", "a tag beyond plain data"),
        ("? [1]\n: 2", "a key is not text"),
        ("a: 1\n---\nb: 2", "second document"),
        ("a: [", "is not YAML"),
        ("# nothing", "is empty"),
    ],
)
def test_yaml_beyond_the_limits_is_refused_at_once(text, said):
    start = time.process_time()
    with pytest.raises(UserError, match="^F: ") as error:
        parse_yaml(text, "F")
    assert said in str(error.value)
    assert time.process_time() - start < 2


def test_yaml_within_the_limits_is_plain_data():
    text = "a: &a {p: 1, q: [yes, ~, 1e3, 2.5, 0x10]}\nb: {<<: *a, p: 2}\nc: *a\nday: 2024-01-31\n1: one"
    data = parse_yaml(text, "F")
    assert data["a"] == {"p": 1, "q": [True, None, 1000.0, 2.5, 16]}
    assert data["b"] == data["a"] | {"p": 2}
    assert data["c"] == data["a"] and data["c"] is not data["a"]  # written out: changing one leaves the other
    assert data["day"] == "2024-01-31" and data["1"] == "one"


def test_a_merge_key_is_no_key_in_quotes_as_in_pyyaml():
    """Each of the two may be given once; PyYAML takes more of them, which this reader refuses as repeated keys."""
    for merge in ("<<", "!!merge <<"):
        text = f"{merge}: {{x: 1, y: 1}}\n'<<': 3\ny: 2"
        assert parse_yaml(text, "F") == yaml.safe_load(text) == {"x": 1, "y": 2, "<<": 3}
    for twice in ("<<: {}\n<<: {x: 1}", "<<: []\n<<: {x: 1}", "'<<': 1\n<<: {}\n'<<': 2"):
        with pytest.raises(UserError, match="'<<' is given twice"):
            parse_yaml(twice, "F")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[" * 100_000, "nested too deeply"),
        ("[" * 70 + "]" * 70, "nested too deeply"),
        ('{"x": ' + "9" * 10_000 + "}", "too many digits"),
        ('{"x": ' + "9" * 50 + "}", "too many digits"),
        ('{"x": 1, "x": 2}', "x: is given twice"),
        ('{"x": [NaN]}', "x[0]: is not finite"),
        ('{"x": 1e999}', "x: is not finite"),
        ('{"x": "\\ud800"}', "not text"),
        ('{"x": 1', "is not JSON"),
    ],
)
def test_json_beyond_the_limits_is_refused(text, said):
    with pytest.raises(UserError, match="^F: ") as error:
        parse_json(text, "F")
    assert said in str(error.value)


def test_infinite_numbers_pass_where_they_mean_something():
    assert parse_json('{"cost": Infinity}', "F", finite=False) == {"cost": float("inf")}


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (XML_BOMB, "declares an entity"),
        ('<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><x>&a;</x>', "declares an entity"),
        ("<a>" * 100_000, "nested too deeply"),
        ("<a>" + "<b/>" * 200_000 + "</a>", "too many elements"),
        ('<?xml version="1.0" encoding="klingon"?><a/>', "unknown encoding"),
        ('<?xml version="1.0" encoding="shift_jis"?><a/>', "is not XML"),
        ("<a x='1' x='2'/>", "duplicate attribute"),
        ("<a", "is not XML"),
    ],
)
def test_xml_beyond_the_limits_is_refused(tmp_path, data, said):
    (tmp_path / "a.xml").write_text(data)
    with pytest.raises(UserError, match=said):
        read_xml(tmp_path / "a.xml")


def test_a_pipe_a_folder_a_device_and_what_is_too_large_are_no_files(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").write_bytes(b"a" * 2000)
    for path, said in (
        (tmp_path / "pipe", "is not a regular file"),
        (tmp_path, "is a folder"),
        ("/dev/zero", "is not a regular file"),
        (tmp_path / "large", "is too large; expected at most 1 kB; got '2 kB'"),
        (tmp_path / "gone", "no such file"),
        (tmp_path / ("a" * 300), "cannot be read: file name too long"),
        (str(tmp_path / "a\0b"), "cannot be read"),
    ):
        with pytest.raises(UserError) as error:
            read_bytes(path, 1000)
        assert said in str(error.value)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ("a: 1".encode("utf-16"), "is UTF-16 text; expected UTF-8"),
        ("a: 1".encode("utf-32"), "is UTF-32 text; expected UTF-8"),
        (b"a: \xff", r"is not UTF-8 text \(byte 3\)"),
        (b" \n", "is empty"),
    ],
)
@pytest.mark.parametrize("read", [read_yaml, read_json])
def test_other_encodings_are_named(tmp_path, data, said, read):
    (tmp_path / "a").write_bytes(data)
    with pytest.raises(UserError, match=said):
        read(tmp_path / "a")


def test_a_byte_order_mark_is_no_mistake(tmp_path):
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbf" + b'{"a": 1}')
    assert read_yaml(tmp_path / "a") == read_json(tmp_path / "a") == {"a": 1}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("format: some/1\ncolour: red", "colour: unknown key; got 'colour'"),
        ("format: some/1\ncolor: red\nsise: 1", "did you mean 'size'"),
        ("format: some/1", "color: is missing"),
        ("format: some/2\ncolor: red", "format: unknown format; expected some/1; got 'some/2'"),
        ("[1]", "is not a thing; expected a mapping with 'format: some/1'; got 'list'"),
    ],
)
def test_the_envelope_names_file_key_and_choices(tmp_path, monkeypatch, text, said):
    monkeypatch.setattr("vispeg.formats.format.DECLARED", [])
    some = Format("some/1", "a thing", keys=("color", "size"), needed=("color",))
    (tmp_path / "a").write_text(text)
    with pytest.raises(UserError) as error:
        some.read(tmp_path / "a")
    assert str(error.value).startswith(f"{tmp_path / 'a'}: ") and said in str(error.value)
    (tmp_path / "a").write_text("format: some/1\ncolor: red")
    assert some.read(tmp_path / "a") == {"color": "red"}


PAST = re.compile(  # ways to read a file past the guard
    r"yaml\.(safe_|full_|unsafe_)?load|json\.load\(|json\.loads\([^)]*read_|ET\.parse|etree\.parse|minidom|pickle\.load"
    r"|allow_pickle=True|np\.loadtxt|np\.genfromtxt|torch\.load\((?!.*weights_only=True)"
)
OWN = {  # what is read there was written by the program a moment ago, or decides nothing; the core has no reader
    "core/lock.py",
    "core/marker.py",
    "learn/run_folder.py",
}


def test_no_file_is_read_past_the_guard():
    past = {
        path.relative_to(ROOT).as_posix()
        for path in ROOT.rglob("*.py")
        if path.parent.name != "formats" and PAST.search(path.read_text(encoding="utf-8"))
    }
    assert past <= OWN


@pytest.mark.parametrize("text", ["3e-5", "-1E6", "+2e3", ".5e-3", "1.e2", "3.0e-5"])
def test_exponents_are_numbers_with_or_without_a_point(text, tmp_path):
    assert parse_yaml(f"x: {text}\ny: '{text}'\n", tmp_path / "x.yaml") == {"x": float(text), "y": text}
