"""Fits to a residual that is rough: they end where nothing but roughness is left, near the true least."""

from __future__ import annotations

import numpy as np
import pytest
from fits import SETTLES, still
from loops import pendulum

from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.identify.checkpoint import Trace
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import fit_job
from vispeg.identify.pool import run_together
from vispeg.identify.space import Space
from vispeg.worlds.world import World

CHATTER = 6.0  # of the squared residual, up and down


class Rough(Evidence):
    """Evidence whose residual is a straight line of three coordinates, beside a number that any change throws anew."""

    rough = 0.0

    def __init__(self, rough: float, chatter: float = CHATTER):
        super().__init__([still(pendulum(), 3.01 - SETTLES)])
        assert self.length == 301
        rng = stream(3, "rough")
        self.rough, self.chatter, self.rows = rough, chatter, 0
        self.jacobian, noise = rng.standard_normal((300, 3)) * [9.0, 5.0, 20.0], rng.standard_normal(300)
        self.noise = noise - self.jacobian @ np.linalg.lstsq(self.jacobian, noise, rcond=None)[0]
        self.truth = Space(at(1e-3, -2e-3, 1e-3), [0], self).start

    def nudge(self, kind, name):
        return 3e-4

    def off(self, world):
        """(3,) optimizer coordinates from the truth."""
        return Space(world, [0], self).start - self.truth

    def each_residual(self, worlds):
        self.rows += len(worlds)
        for w in worlds:
            off = self.off(w)
            thrown = stream(int.from_bytes(off.tobytes()[:7], "big"), "chatter").uniform()
            yield np.append(self.noise + self.jacobian @ off, np.sqrt(self.chatter * thrown))


def at(x, y, z):
    return World().add(EffectInstance.of("hole_offset", "fixture", x=x, y=y, z=z))


def fitted(evidence, trace=None):
    job = fit_job(evidence, at(-1e-3, 1e-3, -2e-3), [0], iterations=20, trace=trace)
    return run_together([job], evidence.residuals)[0]


@pytest.mark.parametrize("chatter", [0.0, CHATTER])
def test_a_fit_ends_within_the_roughness_of_the_least(chatter):
    """A straight line with chatter: what the fit leaves over the least squares is less than the roughness that it is
    told of, and it takes no more rows than four Gauss-Newton steps do."""
    rough = Rough(2 * CHATTER, chatter)
    off = rough.off(fitted(rough).world)
    over = float(np.sum((rough.jacobian @ off) ** 2))
    assert over < rough.rough
    assert rough.rows <= 4 * (1 + 3)
    exact = Rough(0.0, chatter)
    fitted(exact)
    assert chatter == 0.0 or rough.rows < exact.rows


def test_an_exact_residual_is_fitted_to_its_end():
    """Roughness 0 changes nothing: the closed form of linear least squares, to the solver's tolerance."""
    exact = Rough(0.0, 0.0)
    assert np.abs(exact.off(fitted(exact).world)).max() < 1e-4


def test_a_rough_fit_that_was_stopped_goes_on_to_the_same_bits():
    """Its trace holds what was asked: begun anew with it, it ends at the same point and asks for that alone."""
    first, again = Rough(2 * CHATTER), Rough(2 * CHATTER)
    trace = Trace()
    fit = fitted(first, trace)
    same = fitted(again, Trace(points=list(trace.points)))
    np.testing.assert_array_equal(fit.u, same.u)
    assert again.rows == 1 + 3
