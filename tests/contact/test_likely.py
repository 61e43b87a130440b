"""Intervals by the squared residual, and what may be absent: closed form where a residual is a straight line."""

from __future__ import annotations

import numpy as np
import pytest
from straight import Straight

from vispeg.contact.selection.likely import absent, disagreement, intervals
from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.identify.fit import Fit
from vispeg.identify.space import Freedom, Space
from vispeg.worlds.world import World

LASTING = RULES.contact_lasting  # blocks, over which an error of form acts one way


def linear_fit(placed, jacobian, rest, sigma) -> Fit:
    space = Space(World().add(placed), [0], Only(("x", "y", "z")))
    return Fit(space.world, rest, (jacobian,), space, space.start, sigma, np.eye(3), cost=float(np.mean(rest**2)))


class Only(Freedom):
    def __init__(self, names):
        self.names = names

    def frees(self, kind, name):
        return name in self.names


class Line(Straight):
    """Evidence whose residual is a straight line about a fit."""

    def __init__(self, fit: Fit):
        of = zip(fit.space.axes, fit.jacobian.T, strict=True)
        slopes = {(fit.world.effects[a.index].effect, a.name): -column / a.unit for a, column in of}
        super().__init__(fit.residual - fit.jacobian @ fit.u, slopes)


@pytest.mark.parametrize(
    ("rms", "variance"), [(0.9, 1.0), (0.5, 0.25 * LASTING / RULES.contact_correlated), (1.5, 2.25)]
)
def test_an_interval_of_a_smooth_residual_is_what_its_derivatives_say(rms, variance):
    """Linear residuals: ends where the squared residual rises by the quantile, in closed form, others moving along.

    As wide as the errors that an effect is judged by: floors, or less where a fit leaves less, or more.
    """
    rng = stream(6, "likely")
    placed = EffectInstance.of("hole_offset", "fixture", x=1e-3, y=-1e-3, z=2e-3)
    jacobian, noise = rng.standard_normal((420, 3)) * [3.0, 2.0, 30.0], rng.standard_normal(420)
    noise -= jacobian @ np.linalg.lstsq(jacobian, noise, rcond=None)[0]
    noise /= np.sqrt(np.mean(noise**2)) / rms
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    fit = linear_fit(placed, jacobian, noise, np.sqrt(LASTING * np.diag(inverse)))
    world, best = intervals(Line(fit), fit)
    half = np.sqrt(3.84 * LASTING * variance * np.diag(inverse)) * [a.unit for a in fit.space.axes]
    for value, h in zip((world.effects[0].params[k] for k in "xyz"), half, strict=True):
        assert value.high - value.value == pytest.approx(h, rel=1e-6)
        assert value.value - value.low == pytest.approx(h, rel=1e-6)
    np.testing.assert_array_equal(best, fit.u)


def test_a_value_may_be_absent_exactly_where_its_interval_holds_null():
    rng = stream(7, "absent")
    placed = EffectInstance.of("hole_offset", "fixture", x=1e-3, y=-1e-3, z=2e-3)
    jacobian, noise = rng.standard_normal((420, 3)) * [3.0, 1.0, 30.0], np.ones(420)
    noise -= jacobian @ np.linalg.lstsq(jacobian, noise, rcond=None)[0]
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    fit = linear_fit(placed, jacobian, noise, np.sqrt(LASTING * np.diag(inverse)))
    half = np.sqrt(3.84 * LASTING * np.diag(inverse))
    for share, gone in ((0.99, [0, 1, 2]), (1.01, [])):
        assert sorted(absent(Line(fit), fit, [0, 1, 2], fit.u + share * half)) == gone
        assert absent(Line(fit), fit, [1], fit.u - share * half) == gone[1:2]


def test_what_may_be_absent_comes_least_needed_first():
    rng = stream(8, "absent")
    placed = EffectInstance.of("hole_offset", "fixture", x=1e-3, y=-1e-3, z=2e-3)
    jacobian, noise = rng.standard_normal((420, 3)), np.ones(420)
    noise -= jacobian @ np.linalg.lstsq(jacobian, noise, rcond=None)[0]
    fit = linear_fit(placed, jacobian, noise, np.ones(3))
    half = np.sqrt(3.84 * LASTING * np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    assert absent(Line(fit), fit, [0, 1, 2], fit.u + np.array([0.5, 0.9, 0.1]) * half) == [2, 0, 1]


def test_recordings_that_disagree_widen_an_interval_by_birges_ratio():
    """One coordinate, recordings of equal information: chi squared of their own values about the mean, per degree."""
    rng, sizes = stream(9, "disagreement"), [200, 200, 200]
    column = np.tile(rng.standard_normal(200), 3)
    apart = np.array([0.4, -0.1, -0.3])
    placed = EffectInstance.of("hole_offset", "fixture", x=1e-3)
    rest = -np.repeat(apart, 200) * column
    space = Space(World().add(placed), [0], Only(("x",)))
    fit = Fit(
        space.world, rest, (column[:, None],), space, space.start, np.ones(1), np.eye(1), cost=float(np.mean(rest**2))
    )
    (found,) = disagreement(fit, sizes)
    assert found == pytest.approx(float(column[:200] @ column[:200]) * float(apart @ apart) / 2)
    assert disagreement(fit, [600]) == pytest.approx(0.0)


def test_an_interval_has_a_width_where_much_less_is_met_on_the_way():
    """Beyond an edge in z half of the residual is gone: x and y are no surer by that."""
    placed = EffectInstance.of("hole_offset", "fixture", x=1e-3, y=-1e-3, z=2e-3)
    rng = stream(7, "likely")
    jacobian, noise = rng.standard_normal((420, 3)) * [3.0, 2.0, 30.0], rng.standard_normal(420)
    noise -= jacobian @ np.linalg.lstsq(jacobian, noise, rcond=None)[0]
    fit = linear_fit(placed, jacobian, noise, np.sqrt(LASTING * np.diag(np.linalg.inv(jacobian.T @ jacobian))))

    smooth, _ = intervals(Line(fit), fit)
    edge = 0.5 * (2e-3 + smooth.effects[0].params["z"].high)

    class Step(Line):
        def residual(self, world):
            return super().residual(world) * (0.5 if world.effects[0].params["z"].value > edge else 1.0)

    world, best = intervals(Step(fit), fit)
    assert best[2] > fit.u[2], "there the search goes on"
    for name in "xy":
        width, usual = (w.effects[0].params[name] for w in (world, smooth))
        assert width.high - width.low > 0.6 * (usual.high - usual.low)
