"""When to stop: what success does over the interval, by name."""

import numpy as np
import pytest

from vispeg.api.measure.enough import ends, verdict
from vispeg.cli.main import main
from vispeg.core.effect import EffectInstance
from vispeg.core.params import Value
from vispeg.evaluation.statistics.intervals import paired_difference
from vispeg.worlds.measurement_file import load_measurement


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (-0.004, 0.009, "enough"),
        (-0.009, 0.012, "cannot tell"),
        (0.013, 0.05, "measure on"),
        (-0.05, -0.02, "measure on"),
    ],
)
def test_the_interval_of_the_change_decides(low, high, said):
    assert said in verdict(low, high, 400)


def test_four_hundred_episodes_without_a_change_are_enough_and_three_hundred_are_not():
    for count, said in ((400, "enough"), (300, "cannot tell")):
        same = paired_difference(np.ones(count, bool), np.ones(count, bool))
        assert said in verdict(same.low, same.high, count)


def test_the_ends_of_an_effect_leave_alone_what_was_not_measured():
    params = {"mass": Value(1.0, 0.9, 1.1), "z": Value(0.05)}
    assert ends(EffectInstance("payload", "flange", params)) == ({"mass": 0.9, "z": 0.05}, {"mass": 1.1, "z": 0.05})


def test_the_scripted_expert_says_when_to_stop(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mass.csv").write_text("mass_g\n126\n127\n126\n126\n127\n")
    argv = ["measure", "mass", "mass.csv", "--where", "peg", "--resolution", "mass_g=1", "--out", "mass.yaml"]
    assert main([*argv, "--policy", "expert", "--episodes", "4"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "object_mass(peg), expert: over the interval success moves by +0.0 points" in out
    assert "4 episodes cannot tell" in out
    (row,) = load_measurement("mass.yaml").details["enough"]["rows"]
    assert row["episodes"] == 4 and row["low"] < 0 < row["high"]
