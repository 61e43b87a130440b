"""When to stop: what success does over the interval, by name."""

import pytest

from vispeg.api.add import add
from vispeg.api.measure.enough import enough
from vispeg.api.measure.result import MeasurementResult
from vispeg.cli.main import main
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.evaluation.records import Episode
from vispeg.evaluation.statistics import tango
from vispeg.evaluation.stress import sensitivity
from vispeg.evaluation.stress.interval import ends, verdict
from vispeg.worlds.identified import Identified, ranges_of
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
    (what,) = sensitivity.sweeps(file, "iiwa14")
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
        sensitivity.sweeps(file, "iiwa14")


def of_arm(path, robot, *effects):
    torque = Quantity("coulomb_friction", 1.0, "N m", 0.05, None, 1.96, 0.9, 1.1, "gum")
    path.write_text(measurement_text(Measurement("joint", "joint4", (torque,), effects, robot)))


SERVO = EffectInstance("servo", "joint4", {"natural_frequency": Value(30.0, 29.0, 31.0)})
DRY = EffectInstance("coulomb_friction", "joint4", {"torque": Value(1.0, 0.9, 1.1)})


def test_another_arms_joint_of_the_same_name_is_not_played_and_a_servos_loop_left_out(tmp_path):
    """A world's `model:`, a sweep, the question of enough and `add` read a measurement alike."""
    file, model = tmp_path / "joint.yaml", tmp_path / "model.yaml"
    asks = {
        "world": lambda: ranges_of(Identified(file), "iiwa14"),
        "sweep": lambda: sensitivity.sweeps(str(file), "iiwa14"),
        "enough": lambda: enough(load(), ["expert"]),
        "add": lambda: add("iiwa14", str(file), model, overwrite=True),
    }

    def load():
        return MeasurementResult(load_measurement(file), file, "")

    for robot in ("xarm7", "elsewhere/iiwa14.xml"):
        of_arm(file, robot, SERVO, DRY)
        for ask in asks.values():
            with pytest.raises(UserError, match="of another robot"):
                ask()
    of_arm(file, "iiwa14", SERVO, DRY)
    assert [r.effect for r in asks["world"]()] == [s.effect for s in asks["sweep"]()] == ["coulomb_friction"]
    assert [e.effect for e in asks["add"]().added] == ["servo", "coulomb_friction"], "a model may have a servo"
    of_arm(file, "iiwa14", SERVO)
    assert not asks["enough"]().rows, "nothing to play"


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
