"""Detect faults of a signal: saturation, quantization, violated limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

PLATEAU_S = 0.01  # s: an extreme that is held exactly for longer is clipping, not a smooth peak
AT_LIMIT = 0.99  # share of a known limit from which a torque may be clipped
MIN_PLATEAU = 5  # samples
QUANTA = 3.0  # quantization steps of an encoder, least change that is no mere switch between two of them
FEWEST = 5  # differences of readings from which a step shows
NOISE_OF_TEXT = 1e-8  # step relative to the largest value: coarser steps are the sensor's, finer ones text rounding


class Limited(Protocol):
    """A robot that states its limits, in the order of its joints."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        ...

    @property
    def range(self) -> np.ndarray:
        """Lower and upper limit of each joint, (nj, 2) rad."""
        ...

    @property
    def velocity_limit(self) -> np.ndarray:
        """Greatest speed of each joint, (nj,) rad/s; inf if unknown."""
        ...

    @property
    def torque_limit(self) -> np.ndarray:
        """Greatest torque of each joint, (nj,) N m; inf if unknown."""
        ...


@dataclass(frozen=True)
class Limits:
    """Limits of the robot in the recording's joint order; infinite if unknown.

    Attributes:
        range: (nj, 2) rad.
        velocity: (nj,) rad/s.
        torque: (nj,) N m.
    """

    range: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray

    @classmethod
    def of(cls, robot: Limited, joints: Sequence[str] | None = None) -> Limits:
        """Return a robot's limits for `joints` in that order; by default for all joints in the robot's order."""
        order = [robot.joints.index(joint) for joint in (robot.joints if joints is None else joints)]
        return cls(robot.range[order], robot.velocity_limit[order], robot.torque_limit[order])


def saturated(values: np.ndarray, dt: float, limit: float = np.inf) -> np.ndarray:
    """Mark the rows (n,) at which a torque signal (n,) is clipped.

    A row counts if the signal holds its extreme exactly for at least 10 ms and 5 samples, which a smooth peak does
    not, or if it stays that long above 99 % of a known limit (N m). A quantized signal also has flat smooth peaks, so
    there only plateaus count that begin or end with a jump of several quantization steps.

    Args:
        values: (n,) N m, NaN where missing.
        dt: sample period, s.
        limit: the joint's torque limit, N m.
    """
    out = np.zeros(len(values), bool)
    finite = values[np.isfinite(values)]
    if not len(finite) or np.ptp(finite) == 0:
        return out
    least = max(MIN_PLATEAU, int(np.ceil(PLATEAU_S / dt)))
    quantum = quantization(values)
    for extreme in (finite.max(), finite.min()):
        if extreme == 0:
            continue
        flat = [r for r in runs(values == extreme) if r[1] - r[0] >= least]
        if quantum is not None:
            flat = [r for r in flat if _entered_by_a_jump(values, r, 2.5 * quantum)]
        for start, stop in flat:
            out[start:stop] = True
    if np.isfinite(limit):
        for start, stop in runs(np.abs(values) >= AT_LIMIT * limit):
            if stop - start >= least:
                out[start:stop] = True
    return out


def quantization(values: np.ndarray) -> float | None:
    """Estimate the step of a quantized signal (n,), in its unit; None if it does not look quantized.

    Distinct values of a quantized signal differ by whole multiples of one step. The smallest difference, or a simple
    fraction of it, is accepted if all small differences are near whole multiples of it. It is then refined on these by
    least squares.
    """
    finite = values[np.isfinite(values)][:50_000]
    if len(finite) < 20:
        return None
    size = float(np.abs(finite).max())
    levels = np.unique(finite)
    gaps = np.diff(levels)
    gaps = gaps[gaps > NOISE_OF_TEXT * size]
    if len(gaps) < FEWEST or len(gaps) < 0.5 * (len(levels) - 1):
        return None
    smallest = float(np.quantile(gaps, 0.01))
    for divisor in (1, 2, 3):
        step = smallest / divisor
        near = gaps[gaps < 20 * step]
        if len(near) < FEWEST:
            continue
        multiples = np.round(near / step)
        if np.sqrt(np.mean((near / step - multiples) ** 2)) < 0.03:  # 0.29 for values without a step
            return float(near @ multiples / (multiples @ multiples))
    return None


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return (start, stop) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _entered_by_a_jump(values: np.ndarray, run: tuple[int, int], jump: float) -> bool:
    start, stop = run
    before = abs(values[start] - values[start - 1]) if start else 0.0
    after = abs(values[stop - 1] - values[stop]) if stop < len(values) else 0.0
    return bool(max(before, after) > jump)
