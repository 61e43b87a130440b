"""Intervals of the published protocol's parameters, from the curvature of its cost at the optimum.

The cost is the sum over pieces of a 2-norm, so its Gauss-Newton curvature weights each piece by one over its norm.
Errors within a piece are correlated, because it starts from a slightly wrong measured state, so they count as fewer
than their number: by the ratio of the spread of the pieces' gradients to that of independent errors (a block
sandwich, averaged over the directions that the path excites). A direction that the path does not excite keeps the
prior, the parameter's bounds; its interval then spans them, and the value is reported as not determined.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from vispeg.core.effect import effect
from vispeg.core.params import Value
from vispeg.identify.paper.protocol import Coordinates, Pieces, cost, paths
from vispeg.worlds.world import World

STEP = 0.02  # of a typical size, finite-difference step
SHOWN = 1e-6  # of the greatest curvature; directions below it count as not excited
POLISH = 6  # most Gauss-Newton steps


@dataclass(frozen=True)
class Determined:
    """A fitted world with intervals.

    Attributes:
        world: with values and their 95 % intervals.
        undetermined: labels of parameters whose interval holds both null and more than a typical size.
    """

    world: World
    undetermined: tuple[str, ...]


def determine(space: Coordinates, pieces: Pieces, fitted: World, nthread: int = 1) -> Determined:
    """Refine the optimum that the search approached, and compute its intervals.

    Args:
        space: of the fit.
        pieces: fitted.
        fitted: world at the end of the search.
        nthread: threads of the simulation.
    """
    x = Coordinates(fitted, pieces).start
    x, gap, slope = _polished(space, pieces, x, nthread)
    half = _half_widths(space, gap, slope, pieces.compared)
    low, high = space.bounds
    world, undetermined = space.at(x), []
    effects = {(e.effect, e.where): e for e in world.effects}
    for (name, where, key, unit), centre, h, lo, hi in zip(space.axes, x, half, low, high, strict=True):
        instance, null = effects[name, where], effect(name).params[key].null / unit
        ends = max(centre - h, lo), min(centre + h, hi)
        if ends[0] <= null <= ends[1] and h > 1.0:
            undetermined.append(f"{instance.label}.{key}")
        value = Value(float(centre * unit), float(ends[0] * unit), float(ends[1] * unit))
        effects[name, where] = replace(instance, params={**instance.params, key: value})
    return Determined(world.add(*effects.values()), tuple(undetermined))


def _polished(
    space: Coordinates, pieces: Pieces, x: np.ndarray, nthread: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Take Gauss-Newton steps on the protocol's cost; return point, residual (npiece, m), slope (npiece, m, p)."""
    low, high = space.bounds
    gap, slope = _slope(space, pieces, x, nthread)
    best = np.linalg.norm(gap, axis=1).sum()
    for _ in range(POLISH):
        hessian, gradient = _curvature(slope, gap), _gradients(slope, gap).sum(axis=0)
        prior = np.diag(_prior(space, gap, pieces.compared))
        step = np.linalg.solve(hessian + prior, gradient)
        tries = [np.clip(x + share * step, low, high) for share in (1.0, 0.5, 0.2, 0.05)]
        costs = [cost(pieces, y) for y in paths(pieces, [space.at(at) for at in tries], nthread)]
        if min(costs) >= best * (1 - 1e-3):
            break
        best, x = min(costs), tries[int(np.argmin(costs))]
        gap, slope = _slope(space, pieces, x, nthread)
    return x, gap, slope


def _slope(space: Coordinates, pieces: Pieces, x: np.ndarray, nthread: int) -> tuple[np.ndarray, np.ndarray]:
    """Return measured minus simulated (npiece, m) m, and the path's slope (npiece, m, p), m per typical size.

    Both are 0 where no position was measured.
    """
    low, high = space.bounds
    up, down = (np.clip(x + sign * STEP * np.eye(len(x)), low, high) for sign in (1, -1))
    worlds = [space.at(at) for at in (x, *up, *down)]
    y = paths(pieces, worlds, nthread).reshape(len(worlds), len(pieces.segments), -1)
    n = len(x)
    width = np.diagonal(up - down)[:, None, None]
    measured = pieces.measured.reshape(len(pieces.segments), -1)
    slope = np.nan_to_num((y[1 : n + 1] - y[n + 1 :]) / width) * np.isfinite(measured)
    return np.nan_to_num(measured - y[0]), np.moveaxis(slope, 0, -1)


def _norms(gap: np.ndarray) -> np.ndarray:
    return np.maximum(np.linalg.norm(gap, axis=1), 1e-12)


def _curvature(slope: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """Return the Gauss-Newton Hessian (p, p) of the sum of norms."""
    return np.einsum("kmp,kmq,k->pq", slope, slope, 1 / _norms(gap))


def _gradients(slope: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """Return the descent direction (npiece, p) of each piece's norm."""
    return np.einsum("kmp,km,k->kp", slope, gap, 1 / _norms(gap))


def _prior(space: Coordinates, gap: np.ndarray, samples: float) -> np.ndarray:
    """Return the curvature (p,) equivalent to a uniform prior between the bounds, in the cost's unit."""
    low, high = space.bounds
    return 12 / (high - low) ** 2 * _norms(gap).mean() / samples


def _half_widths(space: Coordinates, gap: np.ndarray, slope: np.ndarray, samples: float) -> np.ndarray:
    """Return half of the 95 % intervals, (p,) in typical sizes.

    Args:
        space: of the fit.
        gap, slope: as `_slope` returns them.
        samples: number of compared coordinates in a piece.
    """
    pieces = len(gap)
    hessian, gradients = _curvature(slope, gap), _gradients(slope, gap)
    independent = np.einsum("kmp,kmq->pq", slope, slope) / samples  # covariance of the gradients for independent errors
    scale, axes = np.linalg.eigh(independent)
    informative = scale > SHOWN * scale.max()
    spread = ((gradients @ axes[:, informative]) ** 2).sum(axis=0) / scale[informative] * pieces / (pieces - 1)
    correlated = max(float(spread.mean()), 1.0)  # so many errors count as one
    norm, prior = _norms(gap).mean(), np.diag(_prior(space, gap, samples))
    # errors have variance norm^2 / samples, and `hessian` is divided by the norm already
    information = hessian * samples / (norm * correlated) + prior * samples / norm
    return student.ppf(0.975, pieces - 1) * np.sqrt(np.diagonal(np.linalg.inv(information)))
