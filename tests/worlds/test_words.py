"""Effects as a person writes them: what is not said is as the model has it."""

from vispeg.core.effect import EffectInstance
from vispeg.robots.model import load
from vispeg.worlds.words import parse

HERE = EffectInstance.of("payload", "flange", mass=0.7, z=0.12, radius=0.06)


def test_what_is_not_stated_of_an_effect_that_is_there_is_as_it_is_there():
    robot = load("iiwa14")
    (begun,) = parse("payload:flange:mass=1", robot, [HERE])
    assert {k: v.value for k, v in begun.params.items()} == {"mass": 1.0, "x": 0.0, "y": 0.0, "z": 0.12, "radius": 0.06}
    assert parse("payload:flange", robot, [HERE]) == [HERE]
    (typical,) = parse("payload:flange:mass=1", robot)
    assert (typical.params["z"].value, typical.params["radius"].value) == (0.05, 0.03)
    there = EffectInstance.of("coulomb_friction", "joint2", torque=3.0)
    each = parse("coulomb_friction:each", robot, [there])
    assert [e.params["torque"].value for e in each] == [3.0 if e.where == "joint2" else 0.5 for e in each]
    both = parse("coulomb_friction:each", robot, [EffectInstance.of("coulomb_friction", "all", torque=2.0), there])
    assert [e.params["torque"].value for e in both] == [3.0 if e.where == "joint2" else 2.0 for e in both]
    (one,) = parse("coulomb_friction:joint4", robot, [EffectInstance.of("coulomb_friction", "all", torque=2.0)])
    assert (one.where, one.params["torque"].value) == ("joint4", 2.0)
