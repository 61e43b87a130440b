"""Every broken file of episodes, trials or names is told in one line; nothing is left behind."""

import json

import mutations
import pytest

from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.evaluation.measured import read_csv
from vispeg.evaluation.records import Episode, append, read
from vispeg.evaluation.runner import read_names

HEADS = "policy,seed,outcome,configuration,category,modality,train_seed,time,peak_force"
TRIALS = f"{HEADS}\na,1,success,c,success,depth,0,2.5,8\n"


@pytest.fixture
def episodes(tmp_path):
    made = Episode(
        "a", "depth", 0, "S", "0" * 64, 1, True, "success", 2.5, 8.0, 0.001, 0.02, "", "c", (1.0, 8.0), "v.mp4"
    )
    append(tmp_path / "episodes.jsonl", [made])
    return tmp_path / "episodes.jsonl"


def test_every_change_of_an_episode(episodes):
    found = {}
    with mutations.kept(episodes):
        for what, data in mutations.values(json.loads(episodes.read_text())):
            episodes.write_text(json.dumps(data) + "\n")
            found[what] = mutations.tried(lambda: read(episodes) and None)
    assert not mutations.unclear(found) and len(found) > 200
    for name in ("time", "peak_force", "lateral_error", "depth", "force_profile.0"):
        assert all(found[f"{name} = {bad}"] != "fine" for bad in ("nan", "inf", "'x'", "True", "[]")), name
        assert (found[f"{name} = -1"] == "fine") == (name == "depth")


def test_every_file_that_holds_no_episodes(episodes):
    found = {}
    for what in mutations.files(episodes.parent, [episodes.name]):
        found[what] = mutations.tried(lambda: read(episodes) and None)
    assert not mutations.unclear(found)


@pytest.mark.parametrize("column", range(9))
def test_every_change_of_a_trial(tmp_path, column):
    path, found = tmp_path / "robot.csv", {}
    for bad in (
        "",
        " ",
        "x",
        "-1",
        "nan",
        "inf",
        "-inf",
        "1e999",
        "9" * 5000,
        "1_0",
        "\x00",
        '"',
        "é",
        "=1+1",
        "1;2",
        "\n",
    ):
        heads, cells = (line.split(",") for line in TRIALS.splitlines())
        path.write_text("\n".join([",".join(heads), ",".join([*cells[:column], bad, *cells[column + 1 :]]), ""]))
        found[bad] = mutations.tried(lambda: read_csv(path) and None)
    assert not mutations.unclear(found)
    if heads[column] in ("time", "peak_force"):
        assert all(found[bad] != "fine" for bad in ("-1", "inf", "-inf", "1e999", "x"))
    if heads[column] in ("seed", "train_seed"):
        assert all(found[bad] != "fine" for bad in ("inf", "nan", "9" * 5000, "x"))


def test_every_file_that_holds_no_trials(tmp_path):
    (tmp_path / "robot.csv").write_text(TRIALS)
    found = {}
    for what in mutations.files(tmp_path, ["robot.csv"]):
        found[what] = mutations.tried(lambda: read_csv(tmp_path / "robot.csv") and None)
    assert not mutations.unclear(found) and {what for what, how in found.items() if how == "fine"} <= {"robot.csv half"}


def test_two_columns_of_one_name_are_told(tmp_path):
    (tmp_path / "robot.csv").write_text("policy,seed,seed,outcome\na,1,2,success\n")
    with pytest.raises(UserError, match="two columns of one name; got 'seed'"):
        read_csv(tmp_path / "robot.csv")


def test_every_change_of_what_names_stand_for(tmp_path):
    path = tmp_path / "run.json"
    path.write_text(json.dumps({"policies": {"a/s0": "0"}, "worlds": {"S": "1"}}))
    found = {}
    for what in mutations.json_files(path):
        found[what] = mutations.tried(lambda: read_names(path) and None)
    for what in mutations.files(tmp_path, ["run.json"]):
        found[what] = mutations.tried(lambda: read_names(path) and None)
    assert not mutations.unclear(found)


@pytest.mark.parametrize("bad", ["Infinity", "NaN", "1e400", "-5"])
def test_a_gap_of_impossible_numbers_leaves_nothing(episodes, bad, monkeypatch, capsys):
    monkeypatch.chdir(episodes.parent)
    other = episodes.read_text().replace('"world": "S"', '"world": "T"').replace("0000", "1111")
    episodes.write_text(episodes.read_text() + other.replace('"time": 2.5', f'"time": {bad}'))
    assert main(["gap", "--records", "episodes.jsonl", "--worlds", "S", "T", "--out", "out"]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and "line 2" in lines[0] and "time" in lines[0]
    assert main(["gap", "--records", "episodes.jsonl", "--measured", "no.csv", "--out", "out"]) == 2
    assert [path.name for path in episodes.parent.iterdir()] == ["episodes.jsonl"]
