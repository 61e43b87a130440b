"""Fit to tosses: line searches along each parameter, then a quadratic surface with bootstrap intervals.

Rollouts with contact diverge at edges, so finite differences over small steps are noise, but the error over finite
sizes is smooth. A surface is the squared residual as a quadratic function of the parameters, fitted to its values at
points in a box. Source: response surfaces, Box and Wilson, J. Royal Statistical Society B 13(1), 1951; intervals by
resampling whole blocks (tosses), Efron, Annals of Statistics 7(1), 1979.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.core.params import Value
from vispeg.identify.fit import Fit
from vispeg.identify.pool import Submit
from vispeg.identify.restarts import Restarts
from vispeg.identify.space import Space
from vispeg.worlds.world import World

LINE = np.linspace(-1.0, 1.0, 7)  # points of a line search, in spans
SPANS = (0.7, 0.3)  # optimizer units searched to either side, in each round of line searches
BOX = 0.35  # half width of the first surface's box, optimizer units
NARROW = 0.4  # least half width of the next box, as a share of the last one's
MOVES = 2  # surfaces between the first and the last
DRAWS = 400  # of the bootstrap


def cost(evidence: Restarts, worlds: Sequence[World]) -> np.ndarray:
    """Return the summed squared residual (nworld, nblock) of each block."""
    blocks = evidence.blocks()
    return np.stack([np.bincount(blocks, r * r) for r in evidence.residuals(worlds)])


def _step_sizes(space: Space, u: np.ndarray) -> np.ndarray:
    """Return for each coordinate at `u` the size of one step: 1, or the coordinate's own size.

    The latter is for scales (parameters whose null is not 0) on a linear axis, which thus change by a share of
    themselves.
    """
    return np.array(
        [1.0 if a.param.scale == "log" or a.param.null == 0 else abs(x) for a, x in zip(space.axes, u, strict=True)]
    )


def line_job(
    world: World,
    free: Sequence[int],
    *,
    spans: Sequence[float] = SPANS,
    ended: tuple[Sequence[float], bool] | None = None,
) -> Callable[[Submit], Fit]:
    """Return a job like that of `fit_job`, by line searches along one parameter at a time, the last effect's first.

    Its fit has no derivatives and no intervals, see `with_intervals`. `spans` are the half widths of each round;
    `ended` is as in `fit_job`.
    """

    def job(submit: Submit) -> Fit:
        space = Space(world, free)
        u, (low, high) = space.start if ended is None else np.array(ended[0], float), space.bounds
        for span in spans if ended is None else ():
            for axis in reversed(range(len(u))):
                reach = span * _step_sizes(space, u)[axis]
                x = np.unique(np.clip(u[axis] + reach * LINE, low[axis], high[axis]))
                points = np.repeat(u[None], len(x), axis=0)
                points[:, axis] = x
                u[axis] = lowest(x, np.array([r @ r for r in submit([space.at(p) for p in points])]))
        (r,) = submit([space.at(u)])
        return Fit(space.at(u), r, (np.zeros((len(r), 0)),), space, u, np.zeros(len(u)), np.eye(len(u)))

    return job


def with_intervals(evidence: Restarts, world: World, free: Sequence[int], rng: np.random.Generator) -> World:
    """Return the world at the minimum of a quadratic surface, with 95 % intervals by bootstrap over tosses.

    Each further surface is centred on the previous minimum; if that was inside its box, the next box is about as wide
    as the intervals. It ends when the minimum is inside a box narrower than the first, or after the last surface.
    """
    first = Space(world, free)
    box = BOX * _step_sizes(first, first.start)
    if not len(box):
        return world
    for number in range(MOVES + 2):
        last = number == MOVES + 1
        space = Space(world, free)
        u, (low, high) = space.start, space.bounds
        best, ends = _surface(evidence, space, box, rng)
        at, ends = (np.clip(u + box * x, low, high) for x in (best, ends))
        inside = bool(np.all(np.abs(best) < 1.0))
        if last or (inside and np.all(box < BOX * _step_sizes(space, u))):
            break
        world = space.at(at)
        if inside:  # 0.99: narrower than the first
            box = np.clip(ends[1] - ends[0], NARROW * box, 0.99 * BOX * _step_sizes(space, u))
    effects: list[EffectInstance] = list(world.effects)
    for j, axis in enumerate(space.axes):
        value, *span = (space.backward(float(x), axis) for x in (at[j], ends[0, j], ends[1, j]))
        placed = effects[axis.index]
        params = {**placed.params, axis.name: Value(value, min(*span, value), max(*span, value))}
        effects[axis.index] = EffectInstance(placed.effect, placed.where, params, placed.origin)
    return replace(world, effects=tuple(effects))


def _surface(
    evidence: Restarts, space: Space, box: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return the minimum (k,) of a quadratic surface and its 95 % interval (2, k), as shares of `box`.

    The box of half widths `box` (k,) is about the space's start.
    """
    u, (low, high), k = space.start, space.bounds, len(space.axes)
    design = np.vstack([np.zeros(k), np.eye(k), -np.eye(k), rng.uniform(-1, 1, (8 * k, k))])
    points = np.clip(u + box * design, low, high)
    each = cost(evidence, [space.at(p) for p in points])
    draws = rng.multinomial(each.shape[1], np.full(each.shape[1], 1 / each.shape[1]), size=DRAWS)
    sums = each @ np.vstack([np.ones(each.shape[1]), draws]).T  # (points, 1 + DRAWS)
    fits = np.linalg.lstsq(_terms((points - u) / box), sums, rcond=None)[0]
    at = np.array([_bottom(f, k) for f in fits.T])
    return at[0], np.quantile(at[1:], [0.025, 0.975], axis=0)


def _terms(x: np.ndarray) -> np.ndarray:
    """Return columns 1, x_i, x_i x_j of a quadratic in (n, k)."""
    i, j = np.triu_indices(x.shape[1])
    return np.column_stack([np.ones(len(x)), x, x[:, i] * x[:, j]])


def _bottom(f: np.ndarray, k: int) -> np.ndarray:
    """Return the minimum (k,) of a quadratic with coefficients `f` (of `_terms`), clipped to 1.5 boxes.

    A direction without a minimum is given a slight upward curvature.
    """
    slope, curve = f[1 : 1 + k], np.zeros((k, k))
    curve[np.triu_indices(k)] = f[1 + k :]
    curve = curve + curve.T
    value, vector = np.linalg.eigh(curve)
    value = np.maximum(value, 1e-6 * max(abs(value).max(), 1e-12))
    return np.clip(-(vector / value) @ (vector.T @ slope), -1.5, 1.5)


def lowest(x: np.ndarray, y: np.ndarray) -> float:
    """Return the minimum of the parabola through the least of `y` (n,) and its neighbours; `x` (n,) increases."""
    i = int(np.argmin(y))
    if i in (0, len(x) - 1):
        return float(x[i])
    a, b, _ = np.polyfit(x[i - 1 : i + 2] - x[i], y[i - 1 : i + 2], 2)
    return float(x[i] + np.clip(-b / (2 * a), x[i - 1] - x[i], x[i + 1] - x[i])) if a > 0 else float(x[i])
