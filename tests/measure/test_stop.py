"""When to stop: what success does over the interval, by name."""

import pytest

from vispeg.cli.main import main
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.evaluation.records import Episode
from vispeg.evaluation.statistics import tango
from vispeg.evaluation.stress import sensitivity
from vispeg.evaluation.stress.interval import ends, verdict
from vispeg.worlds.measurement_file import Measurement, Quantity, load_measurement, measurement_text


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
        assert said in verdict(*tango(0, 0, count), count)


def test_the_ends_of_an_effect_leave_alone_what_was_not_measured():
    params = {"mass": Value(1.0, 0.9, 1.1), "z": Value(0.05)}
    assert ends(EffectInstance("payload", "flange", params)) == ({"mass": 0.9, "z": 0.05}, {"mass": 1.1, "z": 0.05})


def measured(path, *effects):
    mass = Quantity("mass", 1.0, "kg", 0.02, None, 1.96, 0.96, 1.04, "gum")
    path.write_text(measurement_text(Measurement("mass", "peg", (mass,), effects)))
    return str(path)


@pytest.mark.parametrize(
    ("high", "said"),
    [(400, "enough, stop measuring"), (360, "measure on"), (399, "cannot tell whether it is under a point")],
)
def test_a_sweep_of_a_measurement_goes_over_its_interval_and_says_when_to_stop(tmp_path, high, said):
    """Success at the low end is 400 of 400, at the high end as many as stated: below one point, enough."""
    params = {"mass": Value(1.0, 0.9, 1.1), "z": Value(0.05)}
    file = measured(tmp_path / "mass.yaml", EffectInstance("payload", "flange", params))
    (what,) = sensitivity.sweeps(file)
    assert [what.at(v)["mass"] for v in what.values] == pytest.approx([0.9, 1.0, 1.1])
    assert {what.at(v)["z"] for v in what.values} == {0.05}
    won = {0.0: 400, 0.5: 400, 1.0: high}
    played = [
        Episode("p", "state", 0, "w", "h", s, s < n, "success", configuration=sensitivity.tag(what, v))
        for v, n in won.items()
        for s in range(400)
    ]
    (curve,) = sensitivity.summarise(played, [what])[0]["curves"]
    assert f"success moves by {(high - 400) / 4 + 0.0:+.1f} points" in curve["words"] and said in curve["words"]


def test_a_measurement_without_an_interval_is_nothing_to_sweep(tmp_path):
    file = measured(tmp_path / "mass.yaml", EffectInstance.of("payload", "flange", mass=1.0))
    with pytest.raises(UserError, match="no effect with an interval"):
        sensitivity.sweeps(file)


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
