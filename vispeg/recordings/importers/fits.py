"""Compare measured torques with the model's: find the joint order in a log, and whether its torques are currents."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from vispeg.recordings.differentiate import smooth
from vispeg.recordings.recording import Recording

Needs = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # motion (n, nj) rad, rad/s, rad/s^2 -> N m
MOTION_HZ = 8.0  # bandwidth of the smoothed motion
POSTURES = 24  # samples at which a joint order is evaluated
MOST = 720  # joint orders up to which all are tried: 6! for six joints
BETTER = 2.0  # factor by which another order must lower the error; a payload or friction alone causes less
SAMPLES = 2000  # rows from which the torque scale is fitted
EXPLAINED = 0.5  # least share of a torque's variance that the model, given friction, explains for its scale to be known
TORQUE = 3.0  # friction, gear errors or a payload change the torque scale by less than this factor
ALIKE = 10.0  # largest plausible ratio between scales in one arm: its motor constants and gears differ by less
TURNS = 2  # reversals of a joint that are needed to separate friction from load
LITTLE = 0.1  # explained share of variance below which a joint's torque reading carries no information
SPEEDS = 0.02  # share of the top speed below which the direction of dry friction counts as undefined


@dataclass(frozen=True)
class Order:
    """A joint order in which measured torques fit the model better than in the log's order.

    Attributes:
        order: for each joint of the robot, its index in the log.
        given, best: RMS difference to the model's torque, N m, in the log's order and in this one.
    """

    order: tuple[int, ...]
    given: float
    best: float


@dataclass(frozen=True)
class Scales:
    """Ratio of measured torque to the model's torque, joint by joint.

    Attributes:
        joints: names.
        scale: (nj,) slope of measured over modelled torque, NaN where it is not known.
        sigma: (nj,) standard deviation of the slope, assuming that the residual is noise.
        explained: (nj,) share of the variance that the slope explains.
        silent: (nj,) bool, joints whose torque reading carries no information.
    """

    joints: tuple[str, ...]
    scale: np.ndarray
    sigma: np.ndarray
    explained: np.ndarray
    silent: np.ndarray

    @property
    def told(self) -> bool:
        """Whether the scales of at least half of the joints are known and similar: one joint may be a coincidence."""
        known = np.abs(self.scale[np.isfinite(self.scale)])
        return len(known) >= max(2, len(self.scale) / 2) and bool(known.max() < ALIKE * known.min())

    @property
    def foreign(self) -> bool:
        """Whether the readings are not torques in N m: the scales are known, and none is near 1."""
        known = self.scale[np.isfinite(self.scale)]
        return self.told and bool(((known < 1 / TORQUE) | (known > TORQUE)).all())

    @property
    def line(self) -> str:
        """Describe the finding in one sentence."""
        known = np.isfinite(self.scale)
        names = [name for name, is_known in zip(self.joints, known, strict=True) if is_known]
        sizes = np.abs(self.scale[known])
        reversed_ = [name for name, s in zip(self.joints, self.scale, strict=True) if s < 0]
        back = f", reversed at {' and '.join(reversed_)}" if reversed_ else ""
        said = f"the measured torque of {', '.join(names)} is in proportion to the model's, by {sizes.min():.2g}"
        said += (
            f" to {sizes.max():.2g}{back}: looks like a current" if len(names) > 1 else f"{back}: looks like a current"
        )
        silent = [name for name, is_silent in zip(self.joints, self.silent, strict=True) if is_silent]
        return said + (f"; left out, as their readings carry no information: {', '.join(silent)}" if silent else "")


def order_that_fits(rec: Recording, needs: Needs) -> Order | None:
    """Find a joint order in which torques fit the model far better than in the log's order; None if there is none.

    Up to six joints all orders are tried; for more, exchanges of two and of three joints, each kept if it lowers the
    error.

    Args:
        rec: with measured torque.
        needs: torques of the robot's model for a motion of its joints.
    """
    found = motion_of(rec, POSTURES)
    if found is None or len(rec.joints) < 2:
        return None
    motion, tau = found

    def error(order: Sequence[int]) -> float:
        """Return the RMS torque residual in this order, after each joint's constant offset is removed."""
        residual = tau[:, order] - needs(*(part[:, order] for part in motion))
        return float(np.sqrt(np.mean((residual - residual.mean(axis=0)) ** 2)))

    n = tau.shape[1]
    given = error(range(n))
    torques = float(np.sqrt(np.mean((tau - tau.mean(axis=0)) ** 2)))
    if given * BETTER < torques:  # the log's order fits
        return None
    best = min(permutations(range(n)), key=error) if math.factorial(n) <= MOST else _exchanged(n, error)
    least = error(best)
    explains = least * BETTER < torques  # no order fits a wrong model
    return Order(tuple(best), given, least) if least * BETTER < given and explains else None


def _exchanged(n: int, error: Callable[[Sequence[int]], float]) -> tuple[int, ...]:
    """Return an order improved by two rounds of exchanges of two joints, then one of three."""
    best, least = list(range(n)), error(range(n))
    for exchanges in (combinations(range(n), 2), combinations(range(n), 2), permutations(range(n), 3)):
        for places in exchanges:
            other = best.copy()
            for place, source in zip(places, (*places[1:], places[0]), strict=True):
                other[place] = best[source]
            if (value := error(other)) < least:
                best, least = other, value
    return tuple(best)


def scales(rec: Recording, needs: Needs) -> Scales | None:
    """Fit the slope of measured over modelled torque, joint by joint, with dry and viscous friction and a constant.

    Args:
        rec: with measured torque.
        needs: torques of the robot's model for a motion of its joints.
    """
    found = motion_of(rec, SAMPLES)
    if found is None:
        return None
    (q, dq, ddq), tau = found
    needed = needs(q, dq, ddq)
    n, nj = tau.shape
    scale, sigma, explained = (np.full(nj, np.nan) for _ in range(3))
    for j in range(nj):
        top = np.quantile(np.abs(dq[:, j]), 0.99)
        if not top > 0 or not np.std(tau[:, j]) > 0:
            explained[j] = 0.0
            continue
        others = np.stack([np.ones(n), dq[:, j], np.tanh(dq[:, j] / (SPEEDS * top))], 1)
        x, y = (v - others @ np.linalg.lstsq(others, v, rcond=None)[0] for v in (needed[:, j], tau[:, j]))
        if not x @ x > 0 or not y @ y > 0:
            explained[j] = 0.0
            continue
        slope = float(x @ y) / float(x @ x)
        explained[j] = slope**2 * float(x @ x) / float(y @ y)
        turns = np.count_nonzero(np.diff(np.sign(dq[np.abs(dq[:, j]) > SPEEDS * top, j])))
        if explained[j] > EXPLAINED and turns >= TURNS:
            scale[j] = slope
            # n less the slope and the three columns of `others`
            sigma[j] = math.sqrt(max(float(y @ y) - slope * float(x @ y), 0.0) / max(n - 4, 1) / float(x @ x))
    known = np.isfinite(scale)
    if not known.any():
        return None
    silent = ~known & (explained < LITTLE)
    return Scales(rec.joints, scale, sigma, explained, silent)


def motion_of(rec: Recording, most: int) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray] | None:
    """Return smoothed motion and torque (n, nj) at up to `most` samples at which all of them are known."""
    if rec.tau is None:
        return None
    motion = smooth(rec.time, rec.q, MOTION_HZ, rec.episode)
    rows = np.flatnonzero(np.isfinite([*motion, rec.tau]).all(axis=(0, 2)))
    if len(rows) < 20:
        return None
    rows = rows[np.linspace(0, len(rows) - 1, min(most, len(rows))).astype(int)]
    return (motion[0][rows], motion[1][rows], motion[2][rows]), rec.tau[rows]
