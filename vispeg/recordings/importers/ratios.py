"""Estimate gear ratios (joint angle over motor angle) from measured torques, each with its interval, or none.

Motor angles are multiplied by a trial factor per joint. The model's torques for that motion, times a free scale, plus
friction and a constant are fitted to the measured torques. Gravity torque depends on the angle nonlinearly and so
identifies the factor; inertial torque alone does not: it is proportional to the factor, so the scale is its alias.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from vispeg.recordings.importers.fits import EXPLAINED, SPEEDS, Needs, motion_of
from vispeg.recordings.recording import Recording

ROWS = 200  # samples at which torques are computed
LEAST, MOST, STEPS = 1 / 400, 2.0, 70  # range of trial factors, and their number
ROUNDS = 3  # rounds of coordinate search: each joint's factor is optimised given the others'
EACH = 5  # rows that count as one independent reading
LEFT = 1e-3  # share of a torque's variance that is assumed to remain unexplained by any model
WHOLE, KNOWN = 0.03, 0.01  # relative half width of the interval up to which an integer, or another ratio, is accepted


@dataclass(frozen=True)
class Ratio:
    """Joint angle over motor angle.

    Attributes:
        value, low, high: the ratio and the ends of its 95 % interval.
        torque: scale of measured over modelled torque at that ratio.
    """

    value: float
    low: float
    high: float
    torque: float

    @property
    def text(self) -> str | None:
        """The ratio as written in a map: `1/8` if 8 is the only integer in 1/ratio's interval; None if not known."""
        first, last = math.ceil(1 / self.high), math.floor(1 / self.low)
        half = (self.high - self.low) / (2 * self.value)
        if first == last and first > 1 and half < WHOLE:
            return f"1/{first}"
        return f"{self.value:.5g}" if half < KNOWN else None

    def __contains__(self, factor: float) -> bool:
        return self.low <= factor <= self.high


def ratios(rec: Recording, needs: Needs, joints: Sequence[int]) -> dict[int, Ratio]:
    """Estimate the ratios of those joints whose ratio the measured torques determine.

    Args:
        rec: recording with measured torque; the angles of `joints` are motor angles, rad.
        needs: torques of the robot's model for a motion of its joints.
        joints: indices of the joints in question.
    """
    found = motion_of(rec, ROWS)
    if found is None or not joints:
        return {}
    (q, dq, ddq), tau = found
    spread = np.std(tau, axis=0)
    varies = spread > 0
    constant = np.ones(len(q))
    others = []
    for j in range(q.shape[1]):
        top = max(float(np.quantile(np.abs(dq[:, j]), 0.99)), 1e-12)
        others.append(np.linalg.qr(np.stack([constant, dq[:, j] / top, np.tanh(dq[:, j] / (SPEEDS * top))], 1))[0])

    def fit(factor: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return per joint (nj,): squared residual, that after friction alone, and slope."""
        needed = needs(q * factor, dq * factor, ddq * factor)
        residual, total, slope = np.zeros(len(factor)), np.zeros(len(factor)), np.zeros(len(factor))
        for j in np.flatnonzero(varies):
            x, y = (v - others[j] @ (others[j].T @ v) for v in (needed[:, j], tau[:, j]))
            slope[j] = float(x @ y) / max(float(x @ x), 1e-300)
            total[j], residual[j] = float(y @ y), float(y @ y) - slope[j] * float(x @ y)
        return residual, total, slope

    def cost(factor: np.ndarray) -> float:
        residual, total, _ = fit(factor)
        return float(np.sum(residual[varies] / np.maximum(total[varies], 1e-300)))

    grid = np.geomspace(LEAST, MOST, STEPS)
    factor = np.ones(q.shape[1])

    def at(j: int | Sequence[int], value: float) -> np.ndarray:
        out = factor.copy()
        out[j] = value
        return out

    factor = at([*joints], min(grid, key=lambda value: cost(at([*joints], value))))
    for _ in range(ROUNDS):
        for j in joints:
            factor = at(j, min([*grid, factor[j]], key=lambda value: cost(at(j, value))))
    free = max(len(q) // EACH - 5, 2)  # less what is fitted to a joint: factor, slope, two frictions and a constant
    floor = LEFT * np.maximum(fit(factor)[1], 1e-300)

    def unlikely(factor: np.ndarray) -> float:
        """Return twice the negative log likelihood, counting only independent readings."""
        return free * float(np.sum(np.log(fit(factor)[0][varies] + floor[varies])))

    def polished(start: np.ndarray, as_one: bool) -> np.ndarray:
        """Return the best factors near a start: one per joint, or with `as_one` a common one."""

        def factors(log: np.ndarray) -> np.ndarray:
            return at([*joints], float(np.exp(log[0]))) if as_one else _with(start, joints, np.exp(log))

        first = np.log(start[[*joints]])
        first = first[:1] if as_one else first
        options = {"xatol": 1e-4, "fatol": 1e-3, "maxfev": 120 * len(first)}
        found = optimize.minimize(lambda log: unlikely(factors(log)), first, method="Nelder-Mead", options=options)
        return factors(found.x)

    factor = polished(factor, False)
    middle = at([*joints], float(np.exp(np.median(np.log(factor[[*joints]])))))
    common = polished(middle, True)
    equal = len(joints) > 1 and unlikely(common) - unlikely(factor) < stats.chi2.ppf(0.95, len(joints) - 1)
    factor = common if equal else factor  # equal gears share one ratio, which is known more precisely
    residual, total, slope = fit(factor)
    explained = 1 - residual / np.maximum(total, 1e-300)
    best, margin = unlikely(factor), stats.f.ppf(0.95, 1, free)
    out = {}
    for j in joints:
        if not varies[j] or explained[j] < EXPLAINED:
            continue
        group = [*joints] if equal else j

        def beyond(log: float, group: int | list[int] = group) -> float:
            return unlikely(at(group, float(np.exp(log)))) - best - margin

        ends = [_end(beyond, float(np.log(factor[j])), way) for way in (-1, 1)]
        out[j] = Ratio(float(factor[j]), float(np.exp(ends[0])), float(np.exp(ends[1])), float(slope[j]))
    return out


def _with(factor: np.ndarray, joints: Sequence[int], values: np.ndarray) -> np.ndarray:
    out = factor.copy()
    out[[*joints]] = values
    return out


def _end(beyond: Callable[[float], float], log: float, way: int) -> float:
    """Find where `beyond` crosses 0 on one side of a minimum, in doubling steps; a far value if it never does."""
    step = 1e-3
    while step < 2.0 and beyond(log + way * step) < 0:
        step *= 2
    if step >= 2.0:
        return log + way * 2.0
    inside = step / 2 if step > 1e-3 else 0.0
    return log + way * float(optimize.brentq(lambda x: beyond(log + way * x), inside, step, xtol=1e-4))
