"""What the article expects of a task follows from the task's own numbers and the user's answers."""

import json

import pytest

from vispeg.api.plan import plan
from vispeg.cli.main import main
from vispeg.evaluation.outlook import EFFORT, NOT, WELL, outlook


@pytest.mark.parametrize(
    ("given", "verdict", "rates"),
    [
        ({"tolerance_mm": 3.0}, EFFORT, [[55, 70]]),
        ({"tolerance_mm": 0.7}, EFFORT, [[55, 70], [30, 50]]),  # between the article's two rows
        ({"tolerance_mm": 0.2}, EFFORT, [[30, 50]]),
        ({"tolerance_mm": 0.2, "repeatability_mm": 1.2}, NOT, [[30, 50]]),
        ({"tolerance_mm": 3.0, "repeatability_mm": 1.2}, EFFORT, [[55, 70]]),
        ({"tolerance_mm": 3.0, "varies": True}, NOT, [[55, 70]]),
        ({"tolerance_mm": 3.0, "soft": True}, NOT, []),
        ({"tolerance_mm": None}, WELL, []),
    ],
)
def test_the_verdict_is_the_articles(given, verdict, rates):
    found = outlook(**({"repeatability_mm": 0.15} | given))
    assert found["verdict"] == verdict and [e["techniques"] for e in found["expected"]] == rates


def test_numbers_decide_what_speaks():
    def speaks(**given):
        return {s["sign"] for s in outlook(0.2, 0.15, **given)["signs"] if s["speaks"]}

    assert speaks() == {"repeatability against the room on a side"}, "0.15 mm in 0.1 mm a side"
    assert "demonstrations needed" in speaks(demonstrations=999)
    assert not {"demonstrations needed", "effort"} & speaks(demonstrations=1000, a_day=100, build_days=10)
    assert "effort" in speaks(demonstrations=1000, a_day=100, build_days=11)
    assert "demonstrations a day" in speaks(a_day=500) and "demonstrations a day" not in speaks(a_day=499)


def test_the_tolerance_is_the_worlds_and_the_command_says_what_python_says(tmp_path, capsys):
    world = tmp_path / "tight.yaml"
    world.write_text("format: vispeg-world/1\nbase: nominal\ntask: {clearance_mm: 0.2}\n")
    assert main(["plan", str(world), "--demonstrations", "300", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said == plan(world, demonstrations=300).record
    assert said["signs"][2]["here"] == "0.2 mm, 0.15 mm"
    world.write_text(world.read_text() + "robot: {repeatability: 0.0012}\n")
    assert plan(world).record["signs"][2]["here"] == "0.2 mm, 1.2 mm", "stated, m"


def test_answers_that_cannot_be_are_one_line(tmp_path, capsys):
    world = tmp_path / "other.yaml"
    world.write_text("format: vispeg-world/1\nbase: nominal\n")
    bad = tmp_path / "bad.yaml"
    bad.write_text("format: vispeg-world/1\nbase: nominal\nrobot: {repeatability: -0.1}\n")
    for argv in (["nowhere"], [str(bad)], [str(world), "--repeatability", "-1"], [str(world), "--a-day", "0"]):
        assert main(["plan", *argv]) == 2
        assert "\n" not in capsys.readouterr().err.strip()
