"""Every effect's parameters are found again in noisy recordings, inside the intervals that the fit states."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from loops import iiwa_segment, mode_of, recorded

from vispeg.core.effect import EffectInstance, searchable
from vispeg.core.params import Param
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.localise import joint_data, missing_torque
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit, fit_job
from vispeg.identify.pool import run_together
from vispeg.robots.model import load
from vispeg.worlds.world import World

REGISTRY = searchable()  # what an arm alone can show

NAMES = sorted(REGISTRY)
ROBOT = load("iiwa14")
TRUTH = {  # limits that this motion runs into without dropping the arm
    "torque_limit": {"limit": 32.0},
    "torque_speed_limit": {"stall": 36.0, "no_load": 4.0},
    "goal_rate_limit": {"rate": 0.35},
}


def truth_of(name: str) -> dict[str, float]:
    """Values away from where the fit starts: magnitudes twice the start's distance from null, shapes a little off."""

    def value(p: Param) -> float:
        if p.scale == "log":
            return 1.2 * p.start
        return p.start + 0.02 * (p.high - p.low) if p.shape else p.null + 2 * (p.start - p.null)

    return TRUTH.get(name) or {k: value(p) for k, p in REGISTRY[name].params.items()}


@lru_cache
def fitted(name: str, seed: int = 5) -> tuple[Fit, float]:
    """The fit to two noisy 1.6 s recordings and the truth's own mean squared whitened residual, of what is compared."""
    kind = REGISTRY[name]
    where = kind.targets(ROBOT)[len(kind.targets(ROBOT)) // 2]
    truth = World().add(EffectInstance.of(name, where, **truth_of(name)))
    motions = [iiwa_segment(mode_of(kind), 1.6, motion) for motion in ("fourier", "triangle")]
    step = min(1e-3, kind.stable_step(truth_of(name)))
    evidence = Evidence(
        [recorded(ROBOT, "iiwa14", truth, s, stream(seed, name, i), h_max=step) for i, s in enumerate(motions)]
    )
    guesses = [{}]
    if where in ROBOT.joints:
        missing = [
            missing_torque(item, y[0]) for item, y in zip(evidence.items, evidence.simulated([World()]), strict=True)
        ]
        guesses += kind.guesses(joint_data(missing, evidence.items)[ROBOT.joints.index(where)])
    start = {k: p.start for k, p in kind.params.items()}
    first, *others = [World().add(EffectInstance.of(name, where, **{**start, **g})) for g in guesses]
    (fit,) = run_together([fit_job(evidence, first, [0], starts=others, iterations=15)], evidence.residuals)
    return fit, float(np.sum(evidence.residuals([truth])[0] ** 2) / evidence.count)


def misses(name: str) -> dict[str, float]:
    """|estimate - truth| over the half-width of the 95 % interval, parameter by parameter."""
    fit, _ = fitted(name)
    out = {}
    for key, true in truth_of(name).items():
        v = fit.world.effects[0].params[key]
        assert v.low is not None and v.high is not None
        out[key] = abs(v.value - true) / max(0.5 * (v.high - v.low), 1e-12)
    return out


@pytest.mark.parametrize("name", NAMES)
def test_truth_is_recovered(name):
    """Every parameter within 1.5 half-widths (three standard errors), and no worse a fit than the truth."""
    fit, cost = fitted(name)
    assert fit.converged and not fit.at_bound and not fit.weak
    kind = REGISTRY[name]
    # roundings never repeat, and the cost depends on where in a step an encoder begins: the median of five draws
    others = [fitted(name, seed) for seed in range(6, 10)] if kind.resolution(truth_of(name)) > 0 else []
    worse = np.median([f.cost / c for f, c in [(fit, cost), *others]])
    assert worse <= (1.01 if kind.smooth else 1.5)
    assert max(misses(name).values()) < 1.5, misses(name)


@pytest.mark.parametrize("name", NAMES)
def test_intervals_say_something(name):
    """A magnitude's interval excludes null and is narrower than half of the value's distance from it."""
    fit, _ = fitted(name)
    kind, params = REGISTRY[name], fit.world.effects[0].params
    for key in kind.magnitudes:
        v, null = params[key], kind.params[key].null
        if key == "motor_inertia":
            continue  # zero is a value among others there
        assert v.low is not None and v.high is not None
        assert v.high - v.low < 0.5 * abs(v.value - null), key
        assert not v.low <= null <= v.high, key


def test_intervals_cover_the_truth():
    """Over all parameters of all effects, the 95 % intervals hold the truth about as often as they say."""
    inside = [miss <= 1.0 for name in NAMES for miss in misses(name).values()]
    assert np.mean(inside) > 0.85, f"{np.mean(inside):.2f} of {len(inside)}"
