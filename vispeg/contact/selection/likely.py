"""Intervals of fitted parameters by the squared residual itself, not by its derivatives.

Where a contact sticks, the derivative by friction is zero: every greater value fits as well, a smaller one does not. An
interval contains the values whose squared residual is within a quantile of the least, where the other parameters follow
by the derivatives. The quantile is scaled by how long an error of form lasts, and by how far recordings disagree.
Sources: profile likelihood, Venzon and Moolgavkar 1988, A method for computing profile-likelihood-based confidence
intervals, Applied Statistics 37(1); Birge 1932, The calculation of errors by the method of least squares, Physical
Review 40, for measurements that disagree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.contact.evidence import ContactEvidence
from vispeg.core.effect import EffectInstance
from vispeg.core.params import Value
from vispeg.core.rules import RULES
from vispeg.identify.fit import Fit
from vispeg.worlds.world import World

ROUNDS = ((1.0,), (2.0,), (4.0, 8.0), (16.0, 64.0))  # multiples of a half interval, until the residual rises
CLOSER = 2  # further evaluations near the end, as the residual may rise abruptly when slip begins
FLAT = 1e-12  # smallest size, against division by 0


@dataclass(frozen=True)
class Ray:
    """A ray from a fit along which one coordinate moves to one side, and the others follow.

    Attributes:
        axis: index of the coordinate.
        direction: (naxis,) step of all coordinates that moves this one by half its interval by derivatives, signed.
        rise: rise of the squared residual above the fit's at which the interval ends.
    """

    axis: int
    direction: np.ndarray
    rise: float


class Ways:
    """Rise of the squared residual along rays from a fit.

    Attributes:
        rays: the rays.
        points: for each ray, (multiple of its direction, rise of the squared residual there), sorted.
        best, least: the coordinates (naxis,) with the least squared residual of all points, and that minus the fit's.
    """

    def __init__(self, evidence: ContactEvidence, fit: Fit):
        self.evidence, self.fit = evidence, fit
        self.rays = _rays(evidence, fit)
        self.points: list[list[tuple[float, float]]] = [[(0.0, 0.0)] for _ in self.rays]
        self.best, self.least = fit.u, 0.0

    def ask(self, wanted: Sequence[tuple[int, float]]) -> None:
        """Evaluate points on rays: (index of the ray, multiple of its direction) each."""
        low, high = self.fit.space.bounds
        at = [np.clip(self.fit.u + share * self.rays[k].direction, low, high) for k, share in wanted]
        residuals = self.evidence.residuals([self.fit.space.at(u) for u in at])
        for (k, share), u, r in zip(wanted, at, residuals, strict=True):
            rise = float(r @ r - self.fit.residual @ self.fit.residual)
            self.points[k] = sorted([*self.points[k], (share, rise)])
            if rise < self.least:
                self.best, self.least = u, rise

    def open(self) -> list[int]:
        """Return the rays that have neither risen enough nor reached a bound."""
        ends = [points[-1] for points in self.points]
        return [
            k
            for k, (ray, (share, rise)) in enumerate(zip(self.rays, ends, strict=True))
            if rise < ray.rise and not _ended(self.fit, ray, share)
        ]


def intervals(evidence: ContactEvidence, fit: Fit) -> tuple[World, np.ndarray]:
    """Return the fitted world with intervals of its values, and the coordinates (naxis,) of the least residual."""
    low, high = fit.space.bounds
    ways = Ways(evidence, fit)
    for shares in ROUNDS:
        ways.ask([(k, share) for k in ways.open() for share in shares])
    for _ in range(CLOSER):
        near = [_near_end(points, ray.rise) for ray, points in zip(ways.rays, ways.points, strict=True)]
        ways.ask([(k, share) for k, shares in enumerate(near) for share in shares])
    effects: list[EffectInstance] = list(fit.world.effects)
    for i, axis in enumerate(fit.space.axes):
        ends = [fit.u[i]]
        for ray, points in zip(ways.rays, ways.points, strict=True):
            if ray.axis == i:
                # as far above the least residual on any ray, which may be below the fit's; at least a share of the rise
                level = ray.rise * max(1.0 + ways.least / ray.rise, RULES.interval_less)
                ends.append(fit.u[i] + _end(points, level) * ray.direction[i])
        values = [fit.space.backward(float(np.clip(e, low[i], high[i])), axis) for e in ends]
        placed = effects[axis.index]
        params = {**placed.params, axis.name: Value(values[0], min(values), max(values))}
        effects[axis.index] = replace(placed, params=params)
    return replace(fit.world, effects=tuple(effects)), ways.best


def absent(evidence: ContactEvidence, fit: Fit, axes: Sequence[int], null: np.ndarray) -> list[int]:
    """Return those of the coordinates `axes` that may be at their `null` (naxis,), the least needed first.

    There the squared residual must not rise by more than chance if the others follow by the derivatives.
    """
    low, high = fit.space.bounds
    asked, points = [], []
    for ray in _rays(evidence, fit):
        way = null[ray.axis] - fit.u[ray.axis]
        if ray.axis in axes and way * ray.direction[ray.axis] >= 0:
            asked.append(ray)
            points.append(np.clip(fit.u + way / ray.direction[ray.axis] * ray.direction, low, high))
    base, residuals = float(fit.residual @ fit.residual), evidence.residuals([fit.space.at(u) for u in points])
    needs = {ray.axis: (float(r @ r) - base) / ray.rise for ray, r in zip(asked, residuals, strict=True)}
    return sorted((axis for axis in needs if needs[axis] <= 1.0), key=lambda axis: needs[axis])


def _rays(evidence: ContactEvidence, fit: Fit) -> list[Ray]:
    """Return rays in both directions along each coordinate."""
    info = fit.jacobian.T @ fit.jacobian
    size = np.sqrt(np.maximum(np.diag(info), FLAT))
    value, vector = np.linalg.eigh(info / np.outer(size, size))
    inverse = (vector / np.maximum(value, 1e-8)) @ vector.T / np.outer(size, size)
    least = evidence.lasting * evidence.variance(fit.cost)
    apart = disagreement(fit, [i.measured.size for i in evidence.items])
    steps = np.abs(fit.space.steps(fit.u))
    out = []
    for i in range(len(fit.u)):
        scale = max(least, float(apart[i]))
        half = min(np.sqrt(RULES.interval * scale * inverse[i, i]), steps[i])
        follow = half * inverse[:, i] / inverse[i, i]
        out += [Ray(i, sign * follow, RULES.interval * scale) for sign in (-1.0, 1.0)]
    return out


def disagreement(fit: Fit, sizes: Sequence[int]) -> np.ndarray:
    """Return the drop of the squared residual (naxis,) per extra value if each item has its own coordinate value.

    To first order; `sizes` are the items' numbers of residuals. 0 if at most one item determines the coordinate.
    """
    of_item = np.repeat(np.arange(len(sizes)), sizes)[:, None] == np.arange(len(sizes))  # (n, nitem) bool
    unit = fit.jacobian / np.maximum(np.linalg.norm(fit.jacobian, axis=0), FLAT)
    out = np.zeros(len(fit.u))
    for i, column in enumerate(unit.T):
        each = column[:, None] * of_item
        each = each[:, np.linalg.norm(each, axis=0) > FLAT]
        if each.shape[1] > 1:
            apart = _unexplained(np.column_stack([np.delete(unit, i, axis=1), each]), fit.residual)
            out[i] = (_unexplained(unit, fit.residual) - apart) / (each.shape[1] - 1)
    return out


def _unexplained(columns: np.ndarray, residual: np.ndarray) -> float:
    """Return the squared residual that no combination of columns explains."""
    change, *_ = np.linalg.lstsq(columns, residual, rcond=1e-6)
    return float(np.sum((residual - columns @ change) ** 2))


def _ended(fit: Fit, ray: Ray, share: float) -> bool:
    """Return whether the coordinate has reached its bound."""
    low, high = fit.space.bounds
    at = fit.u[ray.axis] + share * ray.direction[ray.axis]
    return bool(at <= low[ray.axis] or at >= high[ray.axis])


def _near_end(way: Sequence[tuple[float, float]], rise: float) -> list[float]:
    """Return the multiple at which a ray seems to reach `rise`, and one halfway to the next point; else empty."""
    end = _end(way, rise)
    beyond = [share for share, _ in way if share > end]
    return [end, 0.5 * (end + beyond[0])] if beyond else []


def _end(way: Sequence[tuple[float, float]], rise: float) -> float:
    """Return the multiple at which a ray's points last reach `rise`; 1e9 if the last point is below it.

    Between points the root of the rise is interpolated linearly, which is exact for a linear residual.
    """
    within = max(k for k, (_, r) in enumerate(way) if r <= max(rise, 0.0))
    if within == len(way) - 1:
        return 1e9
    (a, before), (b, after) = way[within], way[within + 1]
    before, level = np.sqrt(max(before, 0.0)), np.sqrt(max(rise, 0.0))
    return float(a + (b - a) * np.clip((level - before) / max(np.sqrt(after) - before, FLAT), 0.0, 1.0))
