"""Fit a world's free parameters to evidence: bounded least squares (scipy) or CMA-ES, with intervals.

A coordinate is a free parameter in optimizer units (`Space`). Derivatives are secants: finite differences of the
whitened residual, (measured - predicted) / noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy import optimize, stats

from vispeg.core.effect import EffectInstance
from vispeg.core.params import Value
from vispeg.identify.checkpoint import Trace
from vispeg.identify.cmaes import minimise
from vispeg.identify.evidence import Evidence
from vispeg.identify.point import Point, Settled
from vispeg.identify.pool import Submit
from vispeg.identify.space import Space
from vispeg.worlds.world import World

# Largest whitened residual that the costs of start points and of CMA-ES count, so that a diverging one does not decide;
# least squares itself has no such limit
ROBUST = 1e3
ITERATIONS = 8  # of least squares
LAPS = 2  # iterations before which no fit is stopped for others
FLAT = 1e-8  # eigenvalue of the scaled J'J under which a combination of coordinates is not determined
BEHIND = 4.0  # times the excess of the best fit, from which another is far behind


@dataclass(frozen=True)
class Fit:
    """A fitted world.

    Attributes:
        world: with fitted values and their 95 % intervals.
        residual: (n,) whitened residual on the fitted evidence.
        columns: derivatives of the residual to the coordinates at the solution, one or two matrices that side by side
            are (n, naxis); the first of two is an earlier fit's, taken as constant and shared in memory.
        space: the coordinates.
        u: (naxis,) the solution.
        sigma: (naxis,) standard error of each coordinate.
        correlation: (naxis, naxis) of the estimates.
        at_bound: labels of parameters that ended at a bound, except shape parameters (`Param.shape`).
        weak: labels of parameters (or directions) that the evidence does not determine.
        converged: whether the optimizer met its tolerance; also True where any further gain would lie within the
            residual's roughness (`Settled`).
        cost: mean squared whitened residual over the readings that are compared.
    """

    world: World
    residual: np.ndarray
    columns: tuple[np.ndarray, ...]
    space: Space
    u: np.ndarray
    sigma: np.ndarray
    correlation: np.ndarray
    at_bound: tuple[str, ...] = ()
    weak: tuple[str, ...] = ()
    converged: bool = True
    cost: float = 0.0

    @property
    def jacobian(self) -> np.ndarray:
        """All derivatives, (n, naxis)."""
        return self.columns[0] if len(self.columns) == 1 else np.column_stack(self.columns)

    @property
    def bare(self) -> Fit:
        """Return the fit without its large arrays, those as long as the recordings."""
        return replace(self, residual=np.zeros(0), columns=(np.zeros((0, len(self.u))),))


class Race:
    """A stopping rule shared by concurrent fits: one stops when another is far ahead, to save its rollouts.

    Fits are compared each time all of them wait for rollouts, so the result does not depend on thread scheduling.
    """

    def __init__(self) -> None:
        self.best = np.inf
        self.reached: list[float] = []  # residuals reached since all fits last waited

    def turn(self) -> None:
        """Update the best residual; called when all fits wait for rollouts."""
        self.best = min([self.best, *self.reached])
        self.reached.clear()

    def check(self, mean_square: float, lap: int) -> None:
        """Raise StopIteration, which ends the fit, if at iteration `lap` it is far behind the best one."""
        self.reached.append(mean_square)
        best = min(self.best, mean_square)
        if lap >= LAPS and mean_square > self.far_behind(best):
            raise StopIteration

    def far_behind(self, best: float) -> float:
        """Return the mean squared residual from which a fit is far behind one that reached `best`.

        A fit is far behind once its excess over 1 is more than `BEHIND` times that of the best, counted as 0.1 or more.
        """
        return 1.0 + BEHIND * max(best - 1.0, 0.1)


class Chase(Race):
    """A stopping rule of one fit: it gives up if, at its rate of decrease, it cannot reach a given residual.

    Each fit has its own, as it compares consecutive iterations. A fit that still falls steeply continues however far
    behind it is, because near a minimum Newton steps square the remaining share of the error.

    Args:
        goal: mean squared residual to reach.
    """

    def __init__(self, goal: float):
        super().__init__()
        self.goal, self.last = goal, np.inf

    def check(self, mean_square: float, lap: int) -> None:
        """Raise StopIteration if a fit cannot reach the goal."""
        before, self.last = self.last, mean_square
        # the steps left multiply the residual by the last step's factor to the power 1, 2, 4, ...
        exponent = 2.0 ** max(ITERATIONS - lap, 0) - 1.0
        if lap >= LAPS and mean_square * min(mean_square / before, 1.0) ** exponent > self.goal:
            raise StopIteration


def fit_job(
    evidence: Evidence,
    world: World,
    free: Sequence[int],
    *,
    starts: Sequence[World] = (),
    iterations: int = ITERATIONS,
    method: Literal["least-squares", "cma"] = "least-squares",
    rng: np.random.Generator | None = None,
    race: Race | None = None,
    trace: Trace | None = None,
    ended: tuple[Sequence[float], bool] | None = None,
    columns: np.ndarray | None = None,
) -> Callable[[Submit], Fit]:
    """Return a job for `run_together` that fits some effects of a world.

    Args:
        evidence: of the fitted recordings.
        world: with start values.
        free: indices of the effects to fit.
        starts: worlds with other start values; least squares begins at the best of all.
        iterations: most points at which least squares is evaluated. The start is one of them, so there are at most
            `iterations - 1` steps, and none for 1. CMA-ES has at most ten times as many generations.
        method: `cma` for CMA-ES, followed by least squares.
        rng: of CMA-ES, which needs it.
        race: rule by which the fit stops early; None for no such rule.
        trace: each step is recorded in it, and the fit resumes from where it ends; None records nothing.
        ended: the end of an earlier run of the same job, in coordinates, and whether it had converged; if given, only
            that point is evaluated.
        columns: (n, k) derivatives to the first k coordinates that an earlier fit had, taken as constant, so that a
            candidate added to many effects needs rollouts for its own parameters only. Residuals are always exact.
    """

    def job(submit: Submit) -> Fit:
        space = Space(world, free, evidence)
        if ended is not None:
            return _summary(evidence, space, np.array(ended[0], float), ended[1], Point(space, submit, columns=columns))
        low, high = space.bounds
        candidates = [space.start] + [Space(w, free, evidence).start for w in starts]
        candidates = [np.clip(u, low + 1e-9, high - 1e-9) for u in candidates]  # least squares starts strictly inside
        if method == "cma":
            candidates.append(_cma(space, candidates[0], submit, iterations * 10, rng, trace))
        best = candidates[0]
        if len(candidates) > 1:
            costs = [] if trace is None else trace.candidates
            if not costs:
                costs = [squares(r) for r in submit([space.at(u) for u in candidates])]
                if trace is not None:
                    trace.chosen(costs)
            best = candidates[int(np.argmin(costs))]
        point = Point(space, submit, trace, columns, evidence.rough)
        point, u, converged = _least_squares(point, best, iterations, race, trace, max(evidence.count, 1))
        return _summary(evidence, space, u, converged, point)

    return job


def squares(r: np.ndarray) -> float:
    """Return the mean squared whitened residual, each residual limited to `ROBUST`."""
    return float(np.mean(np.minimum(r * r, ROBUST**2)))


def _least_squares(
    point: Point, u0: np.ndarray, iterations: int, race: Race | None, trace: Trace | None, count: int
) -> tuple[Point, np.ndarray, bool]:
    """Return `point`, the solution, and `Fit.converged`; the fit begins at `u0` (naxis,).

    `count` readings are compared; the other arguments are as in `fit_job`.
    """
    low, high = point.space.bounds

    def lap(intermediate_result: optimize.OptimizeResult) -> None:
        cost = 2.0 * intermediate_result.cost / count
        if trace is not None:
            trace.lap(intermediate_result.nit, cost)
        if race is not None:
            race.check(cost, intermediate_result.nit)

    try:
        result = optimize.least_squares(
            lambda u: point.answer(u)[:, -1], u0, lambda u: point.answer(u)[:, :-1], bounds=(low, high), method="trf",
            x_scale=1.0, max_nfev=iterations, callback=lap, ftol=5e-4, xtol=1e-4, gtol=1e-12,
        )  # fmt: skip
    except Settled as end:
        return point, end.u, True
    return point, result.x, result.status > 0


def _cma(
    space: Space, u0: np.ndarray, submit: Submit, budget: int, rng: np.random.Generator | None, trace: Trace | None
) -> np.ndarray:
    """Return the best point of a global search by CMA-ES, which works with coordinates scaled to [0, 1] in the bounds.

    `budget` is the number of generations.
    """
    if rng is None:
        raise ValueError("CMA-ES needs a random generator")
    low, high = space.bounds
    span = high - low

    def costs(points: list[np.ndarray]) -> list[float]:
        return [squares(r) for r in submit([space.at(low + span * x) for x in points])]

    zero, ones = np.zeros(len(span)), np.ones(len(span))
    start = (u0 - low) / span
    return low + span * minimise(costs, start, zero, ones, sigma=0.2, generations=budget, rng=rng, trace=trace)


def _summary(evidence: Evidence, space: Space, u: np.ndarray, converged: bool, point: Point) -> Fit:
    """Return the fit that ended at coordinates `u`, with 95 % intervals by Student's t over blocks of time."""
    r, jac = point.at(u)
    columns = (jac,)
    if point.columns is not None:
        own = jac[:, point.columns.shape[1] :]
        columns = (point.columns, own.copy()) if own.size else (point.columns,)
    sigma, correlation, weak = _uncertainty(evidence, r, jac, space)
    low, high = space.bounds
    t = float(stats.t.ppf(0.975, max(2, len(np.unique(evidence.blocks())) - len(u))))
    effects: list[EffectInstance] = list(space.world.effects)
    bound = []
    for axis, value, s, lo, hi in zip(space.axes, u, sigma, low, high, strict=True):
        placed = effects[axis.index]
        interval = [space.backward(np.clip(v, lo, hi), axis) for v in (value - t * s, value + t * s)]
        params = {**placed.params, axis.name: Value(space.backward(value, axis), min(interval), max(interval))}
        effects[axis.index] = EffectInstance(placed.effect, placed.where, params, placed.origin)
        if not axis.param.shape and min(value - lo, hi - value) < 1e-6 * max(1.0, hi - lo):
            bound.append(f"{placed.label}.{axis.name}")
    world = replace(space.world, effects=tuple(effects))
    return Fit(world, r, columns, space, u, sigma, correlation, tuple(bound), weak, converged, evidence.chi2(r))


def inverted(info: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the inverse of J'J (n, n), and its eigenvalues (n,) and eigenvectors (n, n) on the scale of its diagonal.

    In the inverse an eigenvalue is `FLAT` at least: what the evidence does not determine is very uncertain.
    """
    scale = np.sqrt(np.maximum(np.diag(info), 1e-12))
    value, vector = np.linalg.eigh(info / np.outer(scale, scale))
    return (vector / np.maximum(value, FLAT)) @ vector.T / np.outer(scale, scale), value, vector


def _uncertainty(
    evidence: Evidence, r: np.ndarray, jac: np.ndarray, space: Space
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return standard errors that are robust to autocorrelation and misfit, the correlation matrix, and `Fit.weak`.

    The errors are from the cluster-robust sandwich covariance over blocks of time (block form of Newey and West,
    Econometrica 55(3), 1987). They are at least the ordinary ones, which are widened for misfit (a mean squared
    residual above 1) and for correlated noise (`evidence.correlated`), and at least those of the jackknife over items.
    The correlation matrix is that of the ordinary covariance, (J'J)^-1. `r` (n,) and `jac` (n, naxis) are residual and
    derivatives at the solution.
    """
    n = jac.shape[1]
    info = jac.T @ jac
    inverse, value, vector = inverted(info)
    flat = value < FLAT
    blocks = evidence.blocks()
    score = np.zeros((blocks.max() + 1, n))
    np.add.at(score, blocks, jac * r[:, None])
    sandwich = np.diag(inverse @ (score.T @ score) @ inverse)
    ordinary = np.diag(inverse) * max(1.0, evidence.chi2(r)) * evidence.correlated
    variance = np.maximum(sandwich, ordinary)
    spread = _jackknife(evidence, r, jac)
    sigma = np.sqrt(np.maximum(variance, spread**2))
    names = [f"{space.world.effects[a.index].label}.{a.name}" for a in space.axes]
    weak = [names[i] for i in range(n) if info[i, i] < 1.0]  # uncertain by over a unit, even if all others were known
    weak += [" ~ ".join(names[j] for j in np.flatnonzero(np.abs(vector[:, i]) > 0.3)) for i in np.flatnonzero(flat)]
    root = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    return sigma, inverse / np.outer(root, root), tuple(dict.fromkeys(weak))


def _jackknife(evidence: Evidence, r: np.ndarray, jac: np.ndarray) -> np.ndarray:
    """Return the standard error (naxis,) from fits that leave out one item each, to first order; 0 for one item.

    An item may be too short or too quiet to determine all coordinates by itself; the others together do. Source of the
    jackknife: Efron and Stein, Annals of Statistics 9(3), 1981.
    """
    edges = np.cumsum([0, *(item.measured.size for item in evidence.items)])
    pieces = [(jac[a:b], r[a:b]) for a, b in pairwise(edges)]
    if len(pieces) < 2:
        return np.zeros(jac.shape[1])
    info, slope = jac.T @ jac, jac.T @ r
    scale = np.sqrt(np.maximum(np.diag(info), 1e-12))
    shifts = []
    for own, left in pieces:
        rest = (info - own.T @ own) / np.outer(scale, scale)
        shifts.append(-np.linalg.lstsq(rest, (slope - own.T @ left) / scale, rcond=1e-8)[0] / scale)
    n = len(shifts)
    return np.sqrt((n - 1) / n * np.sum((np.array(shifts) - np.mean(shifts, axis=0)) ** 2, axis=0))
