"""Intervals that count the error of the model's form: never narrower, and on the side of null where they were."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.params import Value
from vispeg.diagnosis.conclusion.intervals import absorbed, proportional, share_left, widened
from vispeg.identify.fit import Fit
from vispeg.identify.space import Space
from vispeg.worlds.world import World


def one(name, param, value, low, high):
    placed = EffectInstance.of(name, "joint4")
    placed = EffectInstance(name, "joint4", {**placed.params, param: Value(value, low, high)})
    return World(effects=(placed,))


def fit_of(world: World, jacobian: np.ndarray) -> Fit:
    """A fit of a model that is linear in its coordinates, with these derivatives."""
    space = Space(world, range(len(world.effects)))
    assert jacobian.shape[1] == len(space.axes)
    u = space.start
    return Fit(world, np.zeros(len(jacobian)), (jacobian,), space, u, np.ones(len(u)), np.eye(len(u)))


@given(st.floats(0.1, 3.0), st.floats(0.01, 0.9), st.floats(1.0, 1e4))
def test_a_widened_interval_still_excludes_null_and_is_never_narrower(value, share, after):
    for name, param, sign in (
        ("coulomb_friction", "torque", 1),
        ("joint_bias", "torque", -1),
        ("torque_gain", "gain", 1),
    ):
        null = effect(name).params[param].null
        distance = sign * value * (0.05 if name == "torque_gain" else 1.0)
        ends = sorted(null + distance * (1 + np.array([-share, share])))
        world = one(name, param, null + distance, *ends)
        world = widened(world, [0], absorbed(fit_of(world, np.full((100, 1), 1e3)), share_left(1e4, after)))
        v = world.effects[0].params[param]
        assert v.low <= ends[0] + 1e-12 and v.high >= ends[1] - 1e-12
        assert not v.low <= null <= v.high


STRIBECK = EffectInstance.of("stribeck_friction", "joint4", coulomb=1.0, excess=0.5, velocity=0.05)


def test_what_a_wrong_form_moves_values_by_in_any_direction_is_their_error():
    """Errors of an effect's form, a tenth of its trace, in the span of all derivatives: each value scatters by its own.

    A joint's bias beside it makes up for a part of it, so the effect's own values move farther.
    """
    rng = np.random.default_rng(1)
    world = World(effects=(STRIBECK, EffectInstance.of("joint_bias", "joint2", torque=1.0)))
    jacobian = rng.normal(size=(400, 4)) @ np.array(
        [[1.0, 0.8, 0.0, 0.3], [0.0, 0.5, 0.1, 0.2], [0.0, 0.0, 0.02, 0.1], [0.0, 0.0, 0.0, 0.05]]
    )
    fit = fit_of(world, jacobian)
    units = [a.unit for a in fit.space.axes]
    trace = jacobian[:, 0] * 1.0 / units[0] + jacobian[:, 1] * 0.5 / units[1]
    way = 0.1 * np.linalg.norm(trace) / np.sqrt(3) * rng.normal(size=(4, 20_000))
    moved = np.linalg.lstsq(jacobian, np.linalg.qr(jacobian)[0] @ way, rcond=None)[0][:3].std(axis=1)
    error = absorbed(fit, 0.1)
    for axis, one_sigma in zip(fit.space.axes, moved, strict=False):
        unit = 1.0 if axis.param.scale == "log" else axis.unit
        assert error(0, axis.name) == pytest.approx(1.96 * one_sigma * unit, rel=0.02)


def test_what_another_effect_does_just_as_well_is_not_known():
    """Of two effects with one trace only the sum is determined, so neither's error of form has a useful bound."""
    world = one("coulomb_friction", "torque", 1.0, 0.95, 1.05)
    both = replace(world, effects=(*world.effects, EffectInstance.of("joint_bias", "joint2", torque=1.0)))
    alone = absorbed(fit_of(world, np.full((100, 1), 1.0)), 0.1)(0, "torque")
    assert absorbed(fit_of(both, np.full((100, 2), 1.0)), 0.1)(0, "torque") > 100 * alone


def test_a_size_alone_is_as_uncertain_as_the_share_of_the_error_that_remains():
    """Of one linear effect, both errors are the ratio of the amplitudes: what remains over what was there."""
    world = one("coulomb_friction", "torque", 0.7, 0.69, 0.71)
    share = share_left(101.0, 2.0)
    exact = absorbed(fit_of(world, np.full((50, 1), 3.0)), share)(0, "torque")
    assert exact == pytest.approx(proportional(world, share)(0, "torque"))
    assert exact == pytest.approx(1.96 * 0.1 * 0.7)


def test_no_remainder_widens_nothing_and_a_small_one_adds_as_an_independent_error():
    world = one("coulomb_friction", "torque", 1.0, 0.95, 1.05)
    fit = fit_of(world, np.full((100, 1), 0.5))
    v = widened(world, [0], absorbed(fit, share_left(100.0, 1.0))).effects[0].params["torque"]
    assert (v.low, v.high) == pytest.approx((0.95, 1.05))
    v = widened(world, [0], absorbed(fit, share_left(101.0, 2.0))).effects[0].params["torque"]  # a tenth is left
    assert v.high - 1.0 == pytest.approx(np.hypot(0.05, 0.196))
    assert v.low == pytest.approx(np.exp(-np.hypot(np.log(0.95), 0.196)))


def test_what_may_be_absent_stays_so():
    world = one("coulomb_friction", "torque", 0.1, 0.0, 0.3)
    v = widened(world, [0], absorbed(fit_of(world, np.full((100, 1), 10.0)), share_left(100.0, 50.0)))
    assert v.effects[0].params["torque"].low == 0.0 and v.effects[0].params["torque"].high > 0.3


def test_effects_that_were_not_fitted_keep_their_intervals():
    world = one("coulomb_friction", "torque", 1.0, 0.95, 1.05)
    both = replace(world, effects=(*world.effects, EffectInstance.of("joint_bias", "joint2", torque=1.0)))
    error = absorbed(fit_of(both, np.full((100, 2), 1.0) + np.eye(100, 2)), share_left(100.0, 50.0))
    assert error(0, "torque") > 0 and widened(both, [1], error).effects[0] == world.effects[0]


def test_without_an_error_to_explain_no_share_remains():
    assert share_left(0.9, 0.8) == 0.0 and share_left(2.0, 3.0) == 0.0 and share_left(5.0, 1.0) == 0.0


@given(st.floats(1.0, 100.0))
def test_the_share_that_remains_does_not_depend_on_the_noise(floor):
    """Coarse encoders and noise that is fed back are in both errors; a hundredth of the rest remains, in squares."""
    assert share_left(floor + 100.0, floor + 1.0, floor) == pytest.approx(0.1)


def test_no_end_of_an_interval_moves_inwards():
    """An interval on a log scale that reaches a bound on one side keeps its ends where no error is added."""
    world = one("torque_limit", "limit", 20.0, 10.0, 21.0)
    for error in (0.0, 0.02, 1.0):
        v = widened(world, [0], lambda index, name, error=error: error).effects[0].params["limit"]
        assert v.low <= 10.0 * (1 + 1e-12) and v.high >= 21.0 * (1 - 1e-12)
        assert np.log(v.high / v.value) == pytest.approx(np.hypot(np.log(21.0 / 20.0), error))


@np.errstate(all="raise")
def test_an_error_without_bound_widens_to_the_bounds():
    """Also on a log scale, of which the exponential would overflow."""
    world = one("servo", "natural_frequency", 20.0, 18.0, 22.0)
    v = widened(world, [0], lambda index, name: 1e6).effects[0].params["natural_frequency"]
    p = effect("servo").params["natural_frequency"]
    assert (v.low, v.value, v.high) == (pytest.approx(p.low), 20.0, pytest.approx(p.high))
