"""Intervals that count the error of the model's form: never narrower, and on the side of null where they were."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.params import Value
from vispeg.diagnosis.conclusion.intervals import widened
from vispeg.worlds.world import World


def one(name, param, value, low, high):
    placed = EffectInstance.of(name, "joint4")
    placed = EffectInstance(name, "joint4", {**placed.params, param: Value(value, low, high)})
    return World(effects=(placed,))


@given(st.floats(0.1, 3.0), st.floats(0.01, 0.9), st.floats(1.0, 1e4))
def test_a_value_that_left_out_null_still_does_and_is_never_surer(value, share, after):
    for name, param, sign in (
        ("coulomb_friction", "torque", 1),
        ("joint_bias", "torque", -1),
        ("torque_gain", "gain", 1),
    ):
        null = effect(name).params[param].null
        distance = sign * value * (0.05 if name == "torque_gain" else 1.0)
        ends = sorted(null + distance * (1 + np.array([-share, share])))
        world = widened(one(name, param, null + distance, *ends), 0, 1e4, after)
        v = world.effects[0].params[param]
        assert v.low <= ends[0] + 1e-12 and v.high >= ends[1] - 1e-12
        assert not v.low <= null <= v.high


def test_no_remainder_widens_nothing_and_a_small_one_adds_as_a_relative_error():
    world = one("coulomb_friction", "torque", 1.0, 0.95, 1.05)
    v = widened(world, 0, 100.0, 1.0).effects[0].params["torque"]
    assert (v.low, v.high) == pytest.approx((0.95, 1.05))
    v = widened(world, 0, 101.0, 2.0).effects[0].params["torque"]  # a tenth of the amplitude is left
    assert v.high - 1.0 == pytest.approx(np.hypot(0.05, 0.196), rel=0.15)
    assert 1.0 - v.low == pytest.approx(np.hypot(0.05, 0.196), rel=0.15)


def test_what_may_be_absent_stays_so():
    v = widened(one("coulomb_friction", "torque", 0.1, 0.0, 0.3), 0, 100.0, 50.0).effects[0].params["torque"]
    assert v.low == 0.0 and v.high > 0.3
