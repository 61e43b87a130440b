"""Values that no command can use are refused in one line before any work, and nothing is written."""

import os

import pytest

NOT_UTF8 = os.fsdecode(b"na\xefve")


@pytest.mark.parametrize(
    ("out", "words"),
    [
        ("x" * 300, ("--out", "255 bytes", "300 characters")),
        ("a/" * 2500 + "b", ("--out", "4095")),
        ("~nobodysuch/x", ("--out", "no such user")),
        (NOT_UTF8, ("--out", "UTF-8", "na")),
        ("a\0b", ("--out", "zero byte")),
    ],
)
def test_impossible_paths(refused, out, words):
    refused(["add", "iiwa14", "payload", "flange", "--out", out], *words)
    refused(["compare", "iiwa14", "--recording", out, "--out", "c"], "--recording", *words[1:])


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("format: vispeg-world/1\nbase: nominal\nrobot: {model: ~nobodysuch/arm.xml}\n", "robot"),
        ("format: vispeg-world/1\nbase: nominal\nmodel: ~nobodysuch/model.yaml\n", "model.file"),
        ("format: vispeg-world/1\nbase: ~nobodysuch/world.yaml\n", "no such user"),
        ("format: vispeg-model/1\ncell: {robot: {model: ~nobodysuch/arm.xml}}\n", "cell.robot"),
        ("format: vispeg-model/1\ncell: ~nobodysuch/world.yaml\n", "cell.world"),
    ],
)
def test_no_such_home_folder_in_a_file(refused, tmp_path, text, key):
    (tmp_path / "stated.yaml").write_text(text)
    world = ["evaluate", "expert", "--world", "stated.yaml", "--out", "played"]
    model = ["add", "stated.yaml", "payload", "flange", "--out", "model.yaml"]
    refused(world if "world/1" in text else model, "stated.yaml", key, "no such user", "~nobodysuch")


def test_a_home_folder_that_the_shell_left_alone(vispeg, tmp_path, monkeypatch):
    home, work = tmp_path / "home", tmp_path / "work"
    home.mkdir(), work.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(work)
    code, _, err = vispeg("evaluate", "expert", "--world=nominal", "--episodes=1", "--out=~/played")
    assert not code, err
    assert "evaluate.html" in {f.name for f in (home / "played").iterdir()}
    assert not list(work.iterdir())


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("diagnose iiwa14 --recording a --validate b --out d --seed -1", ("--seed", "-1", "2^63")),
        ("diagnose iiwa14 --recording a --validate b --out d --seconds 1e30", ("--seconds", "1e+09")),
        ("record iiwa14 --motion fourier --out r --duration nan", ("--duration", "nan")),
        ("record iiwa14 --motion fourier --out r --kp 1 b", ("--kp: is not understood; expected numbers; got '1 b'",)),
        ("record iiwa14 --motion fourier --out r --table cvs", ("--table: is not one of", "did you mean 'csv'")),
        ("record iiwa14 --motion fourier --out r --effects", ("--effects: has no value",)),
        (
            "effects --family nope",
            ("choices: appearance, body, camera, contact, drive, joint, sensor, task;",),
        ),
        ("record iiwa14 --motion fourier --effects --out r", ("--effects: has no value",)),
        ("gap expert --worlds --out g", ("--worlds: has no value",)),
        ("run expert --robot sim:nominal --goal 1 2 --out t", ("--goal: is not understood; expected three numbers",)),
        ("record iiwa14 --motion fourier --out r --duration 0", ("ten samples", "got '0 s at")),
        ("motions fourier --out m.csv --duration 0", ("ten samples", "got '0 s at")),
        ("motions look --out m.csv --duration 0", ("--duration", "got '0 s at")),
        ("record peg-cell --motion look --out r --duration 0", ("--duration", "got '0 s at")),
        ("record iiwa14 --motion fourier --out r --rate inf", ("--rate", "inf")),
        ("gap expert --worlds nominal --out g --episodes -3", ("--episodes", "-3")),
        ("train peg-state --out t --steps abc", ("--steps", "a whole number", "abc")),
        ("record iiwa14 --motion fourier --out r --duration long", ("--duration", "a number", "long")),
    ],
)
def test_impossible_numbers(refused, command, words):
    refused(command.split(), *words)


@pytest.mark.parametrize("columns", ["80", "40"])
@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("record iiwa14", "--motion NAME and --out PATH are required; see vispeg record --help"),
        ("fit iiwa14", "--out PATH is required; see vispeg fit --help"),
        ("camera calibrate", "IMAGES, --square X and --out PATH are required;"),
        ("gap --nope 3", "--out PATH is required; Unrecognized options: --nope 3"),
    ],
)
def test_what_is_required_is_named_and_nothing_else(refused, command, words, columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", columns)
    refused(command.split(), f"error: {words}")


def test_help_of_a_command_by_name(vispeg):
    assert vispeg("help", "camera", "calibrate") == vispeg("camera", "calibrate", "--help")


def test_a_dataset_that_cannot_teach_is_refused_before_anything_is_played(refused, tmp_path):
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "notes.txt").write_text("no dataset")
    command = "finetune depth-S --world S --dataset frames --episodes 50 --out tuned"
    refused(command.split(), "frames")
