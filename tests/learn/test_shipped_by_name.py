"""A policy that comes with the package goes by its name in every command that takes one, wherever the user stands."""

import json
from pathlib import Path

import pytest

from vispeg.cli.main import main
from vispeg.core.assets import assets
from vispeg.learn.methods.finetune import FinetuneSettings, finetune_in_worlds
from vispeg.learn.policy import load
from vispeg.learn.shipped import names, policy_folder
from vispeg.learn.teacher import teacher_of
from vispeg.task.peg.config import PegConfig


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_export_and_combine_write_them(tmp_path):
    pytest.importorskip("onnx")
    assert main(["export", "state-3mm", "--out", "p.onnx"]) == 0 and (tmp_path / "p.onnx").stat().st_size > 1e5
    assert main(["combine", "depth-S", "state-0.5mm", "--out", "both"]) == 0
    own = [json.loads((tmp_path / "both" / part / "policy.json").read_text()) for part in ("coarse", "fine")]
    assert [one["modality"] for one in own] == ["depth", "state"]


def test_play_and_teachers_take_them(capsys, tmp_path):
    assert main(["play", "depth-S", "--episodes", "1", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["policy"], said["world"]) == ("depth-S", "S") and len(said["films"]) == 1
    assert (tmp_path / said["films"][0]["file"]).stat().st_size > 1000
    assert teacher_of("state-3mm-randomized", PegConfig()).policy.meta["world_file"] == "randomized"


@pytest.mark.slow
def test_finetune_takes_them_and_does_what_its_options_say():
    few = {"demos": 1, "updates": 2, "known": 0.0, "episodes": 3}
    options = [text for name, value in few.items() for text in (f"--{name}", str(value))]
    assert main(["finetune", "depth-S", "--world", "dev", *options, "--out", "tuned"]) == 0
    settings = json.loads(Path("tuned", "finetune.json").read_text())["settings"]
    assert {name: settings[name] for name in few} == few and load("tuned").modality == "depth"


@pytest.mark.slow
def test_a_known_share_is_played_with_the_tolerance_that_the_policy_was_made_for(tmp_path):
    """Two ways that must agree: the world in its record, and a file that states that world with this tolerance."""
    own = tmp_path / "own.yaml"
    own.write_text("format: vispeg-world/1\nbase: randomized\ntask: {clearance_mm: 0.5}\n")
    few = FinetuneSettings(demos=1, updates=2, known=0.5, known_steps=100, rows=2, episodes=1)
    weights = []
    for known in (None, str(own)):
        out = tmp_path / f"tuned-{known is None}"
        finetune_in_worlds(policy_folder("state-0.5mm"), "nominal", known, "expert", out, few, 0, say=lambda line: None)
        weights.append((out / "policy.safetensors").read_bytes())
    assert weights[0] == weights[1]


def test_a_folder_of_ones_own_comes_before_a_shipped_policy_of_its_name(tmp_path):
    assert policy_folder("rgb-S") == assets() / "policies" / "rgb-S"
    (tmp_path / "rgb-S").mkdir()
    assert policy_folder("rgb-S").resolve() == tmp_path / "rgb-S"


@pytest.mark.parametrize(
    "command",
    [
        ["play", "depht-S"],
        ["export", "depht-S", "--out", "x.onnx"],
        ["combine", "depht-S", "state-3mm", "--out", "x"],
        ["finetune", "depht-S", "--world", "dev", "--out", "x"],
        ["finetune", "depth-S", "--teacher", "depht-S", "--world", "dev", "--out", "x", "--episodes", "1"],
        ["evaluate", "depht-S", "--out", "x"],
    ],
)
def test_a_misspelt_name_is_one_line_with_the_choices_and_leaves_nothing(command, capsys, tmp_path):
    assert main(command) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert "no such policy" in said[-1] and "did you mean 'depth-S'" in said[-1] and "state-3mm" in said[-1]
    assert len(said) == 1 and not list(tmp_path.iterdir())


def test_all_of_them_are_listed():
    assert set(names()) == {path.name for path in (assets() / "policies").iterdir() if path.is_dir()}
    assert load(names()[0]).meta
