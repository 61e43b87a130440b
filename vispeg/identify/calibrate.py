"""Fit named effects to recordings from several starts, as `vispeg fit` does.

A start is the point from which one optimizer sets out. A magnitude is a parameter whose null, a value such as 0,
removes its effect; a shape is any other parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.identify.checkpoint import Checkpoint
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit, fit_job
from vispeg.identify.pool import Submit, run_together
from vispeg.identify.space import Axis, Space
from vispeg.worlds.world import World

Method = Literal["auto", "least-squares", "cma"]
ITERATIONS = 15  # most points that least squares evaluates; CMA-ES gets ten times as many generations
# Shares of the magnitudes at which each start is tried too: a typical size for the shoulder is far too much for a wrist
SHRINK = (0.3, 0.1, 0.03, 0.003)
STRONG = 0.95  # correlation above which two parameters are reported as hardly distinguishable


@dataclass(frozen=True)
class Calibration:
    """The best fit, the mean squared whitened residual at which each start ended, and the method.

    The first start has the model's own values.
    """

    fit: Fit
    costs: tuple[float, ...]
    method: str


def chosen(method: Method, effects: Sequence[EffectInstance]) -> Literal["least-squares", "cma"]:
    """Return the method to use for these effects.

    `auto` means CMA-ES if the residual is not smooth in some effect, else least squares. CMA-ES is always followed by
    least squares.
    """
    if method != "auto":
        return method
    return "least-squares" if all(effect(e.effect).smooth for e in effects) else "cma"


def calibrate(
    evidence: Evidence,
    world: World,
    free: Sequence[int],
    *,
    seed: int,
    method: Method = "auto",
    starts: int = 1,
    iterations: int = ITERATIONS,
    checkpoint: Checkpoint | None = None,
    say: Callable[[str], None] | None = None,
    evaluate: Submit | None = None,
) -> Calibration:
    """Fit the effects at `free` (indices into `world.effects`); the rest of the world stays.

    Args:
        evidence: of the fitted recordings.
        world: with the values to start from.
        free: indices of the fitted effects.
        seed: of the random starts and of CMA-ES.
        method: see `chosen`.
        starts: number of optimizers; the first starts at the world's values, the others at random ones.
        iterations: as in `fit_job`.
        checkpoint: stores the optimizers' progress.
        say: called with messages on what is simulated.
        evaluate: computes residuals of worlds; by default in this process.
    """
    how = chosen(method, [world.effects[i] for i in free])
    space, jobs = Space(world, free), []
    for i in range(starts):
        begin = world if i == 0 else space.at(_draw(space, stream(seed, "fit", "start", i)))
        trace = checkpoint.traces[i] if checkpoint is not None else None
        rng, gentler = stream(seed, "fit", "cma", i), [_shrunk(begin, free, share) for share in SHRINK]
        options = {"iterations": iterations, "method": how, "rng": rng, "trace": trace}
        jobs.append(fit_job(evidence, begin, free, starts=gentler, **options))
    fits = run_together(jobs, evaluate or evidence.residuals, say, length=evidence.length)
    best = min(fits, key=lambda f: f.cost)
    return Calibration(best, tuple(f.cost for f in fits), how)


def strong_pairs(fit: Fit) -> list[tuple[str, str, float]]:
    """Return the pairs of parameters that these recordings hardly distinguish: labels and correlation."""
    names = labels(fit)
    c = fit.correlation
    return [
        (names[i], names[j], float(c[i, j]))
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(c[i, j]) >= STRONG
    ]


def labels(fit: Fit) -> list[str]:
    """Return the label of each coordinate of a fit, such as `coulomb_friction(joint4).torque`."""
    return [f"{fit.space.world.effects[a.index].label}.{a.name}" for a in fit.space.axes]


def _shrunk(world: World, free: Sequence[int], share: float) -> World:
    """Return the world with the free effects' magnitudes at `share` of their distance from null.

    Shapes, and magnitudes on a log scale, stay.
    """
    effects = list(world.effects)
    for i in free:
        kind, placed = effect(effects[i].effect), effects[i]
        nulls = {m: kind.params[m].null for m in kind.magnitudes if kind.params[m].scale == "linear"}
        moved = {m: null + share * (placed.params[m].value - null) for m, null in nulls.items()}
        inside = {m: float(np.clip(v, kind.params[m].low, kind.params[m].high)) for m, v in moved.items()}
        effects[i] = placed.with_values(**inside)
    return replace(world, effects=tuple(effects))


def _draw(space: Space, rng: np.random.Generator) -> np.ndarray:
    """Return coordinates of a random start: linear magnitudes up to 4 typical sizes from null, all else in bounds."""
    low, high = space.bounds
    return np.array([_draw_one(space, a, lo, hi, rng) for a, lo, hi in zip(space.axes, low, high, strict=True)])


def _draw_one(space: Space, axis: Axis, low: float, high: float, rng: np.random.Generator) -> float:
    """Return one coordinate of a random start within bounds."""
    if axis.param.shape or axis.param.scale == "log":
        return float(rng.uniform(low, high))
    null, typical = axis.param.null, axis.param.start - axis.param.null
    reach = 4.0 * abs(typical) / axis.unit if typical else 0.25 * (high - low)
    centre = space.forward(null, axis)
    return float(rng.uniform(max(low, centre - reach), min(high, centre + reach)))
