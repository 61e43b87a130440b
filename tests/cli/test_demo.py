"""The bundled recordings and `vispeg demo`: what is hidden is found, and the table comes first."""

import json

import numpy as np
import pytest

from vispeg.api.recording.check import limits_of
from vispeg.core.assets import assets
from vispeg.diagnosis.run import diagnose
from vispeg.recordings.checks.check import check
from vispeg.recordings.load import load
from vispeg.worlds.world import World

RIGS = ("rig-a", "rig-b", "rig-c")


def test_bundled_recordings_are_small_whole_and_say_what_is_hidden():
    folder = assets() / "recordings"
    assert sum(f.stat().st_size for f in folder.rglob("*") if f.is_file()) < 1.5e6
    for name in RIGS:
        rec = load(folder / name)
        assert rec.control.mode == "position" and len(rec.time) == 2500 and rec.robot == "iiwa14"
        text = (folder / name / "recording.yaml").read_text()
        assert "friction" not in text and "payload" not in text
    hidden = json.loads((folder / "truth.json").read_text())["hidden"]
    assert {(h["effect"], h["where"]) for h in hidden} == {("coulomb_friction", "joint4"), ("payload", "flange")}


@pytest.mark.parametrize("name", RIGS)
def test_no_bundled_recording_breaks_a_limit_of_the_robot(name):
    rec = load(assets() / "recordings" / name)
    for joint in check(rec, limits_of(rec)).joints:
        assert joint.over_velocity == joint.outside_range == joint.over_torque == 0 and not joint.saturated, joint.name


def test_truth_explains_the_bundled_recordings_of_another_program(vispeg, tmp_path):
    """The plant that made them shares no code with the effects; its parameters must leave a hundredth of the error."""
    settings = {h["effect"]: h for h in json.loads((assets() / "recordings" / "truth.json").read_text())["hidden"]}
    model = "iiwa14"
    for i, h in enumerate(settings.values()):
        values = [f"{k}={v}" for k, v in h["params"].items()]
        assert vispeg("add", model, h["effect"], h["where"], "--set", *values, "--out", f"{i}.yaml")[0] == 0
        model = f"{i}.yaml"
    errors = []
    for out, given in (("nominal", "iiwa14"), ("true", model)):
        assert vispeg("compare", given, "--recording", assets() / "recordings" / "rig-c", "--out", out)[0] == 0
        errors.append(json.loads((tmp_path / out / "compare.json").read_text())["ladder"][0]["heldout_error"])
    assert errors[1] < 0.01 * errors[0]


@pytest.mark.slow
def test_a_diagnosis_names_what_is_hidden_and_nothing_beside_it():
    """The demo's search, with neither pictures nor advice: several at a time are no better than the true two."""
    folder = assets() / "recordings"
    a, b, c = ([load(folder / name)] for name in RIGS)
    found = diagnose(World("iiwa14"), [*a, *b], c, nthread=1, plan_next=False)
    assert found.record["verdict"] == "identified"
    assert named(found.record) == {("coulomb_friction", "joint4"), ("payload", "flange")}
    left = np.sqrt(np.nanmean((found.arrays["0/measured"] - found.arrays["0/after"]) ** 2))
    assert found.record["ladder"][-1]["heldout_error"] == pytest.approx(left, rel=1e-4), "of the model that is written"


def test_demo_refuses_before_it_works(refused, tmp_path):
    (tmp_path / "vispeg-demo").mkdir()
    (tmp_path / "vispeg-demo" / "mine").write_text("mine")
    refused(["demo"], "vispeg-demo", "not empty")


@pytest.mark.slow
def test_demo_finds_what_is_hidden(vispeg, tmp_path):
    code, out, _ = vispeg("demo", "--quiet")
    assert code == 0
    lines = [line for line in out.splitlines() if line.strip()]
    assert lines[0].split()[0] == "Model" and lines[2].split()[0] == "nominal"  # the falling error comes first
    record = json.loads((tmp_path / "vispeg-demo" / "diagnosis.json").read_text())
    assert record["verdict"] == "identified" and record["next_experiment"] is None
    assert "the robot and its cell: vispeg-demo/robot.png" in out
    page = (tmp_path / "vispeg-demo" / "report.html").read_text()
    assert page.index('class="robot"') < page.index("<dl") and page.count('class="mark"') == 2
    assert named(record) == {("coulomb_friction", "joint4"), ("payload", "flange")}
    assert {"report.html", "model.yaml", "compared", "robot.png", "contact-sheet.png"} <= {
        p.name for p in (tmp_path / "vispeg-demo").iterdir()
    }


def named(record):
    """(effect, where) of what a record names; the true friction and mass lie within their intervals."""
    found = {(e["effect"], e["where"]): e["params"] for e in record["effects"]}
    torque, mass = found["coulomb_friction", "joint4"]["torque"], found["payload", "flange"]["mass"]
    assert torque["low"] <= 1.2 <= torque["high"] and mass["low"] <= 0.6 <= mass["high"]
    return set(found)
