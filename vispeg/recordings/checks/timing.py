"""Examine sample times: rate, jitter, gaps, and readings that were lost and replaced by repeats or zeros."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.recordings.checks.quality import QUANTA, quantization
from vispeg.recordings.recording import Recording

MOVED = 0.25  # usual changes of a joint, least change after a held reading: an arm that starts from rest changes less
HELD = 0.15  # s, a sensor's slowest usual period (10 Hz) and half of it
GAP = 1.5  # sample periods: a longer step means that at least one sample was lost


@dataclass(frozen=True)
class Gap:
    """A gap: it begins at `start` (s, on the recording's clock) and lasts `seconds`; `samples` are missing in it."""

    row: int
    start: float
    seconds: float
    samples: int


@dataclass(frozen=True)
class Timing:
    """The clock of a recording.

    Attributes:
        rate_hz: one over the median sample period.
        stated_hz: what recording.yaml says.
        jitter: RMS deviation of the sample period from its median, s, gaps left out.
        jitter_max: the largest such deviation, s.
        gaps: steps longer than 1.5 periods.
        repeated: rows whose angles are those of the row before, bit for bit, while the arm moved (`held`).
        zeroed: rows with all angles exactly zero between nonzero rows (a lost reading written as zero).
        duration_s: sum over episodes.
        episodes: their number.
    """

    rate_hz: float
    stated_hz: float
    jitter: float
    jitter_max: float
    gaps: tuple[Gap, ...]
    repeated: int
    zeroed: int
    duration_s: float
    episodes: int


def timing(rec: Recording) -> Timing:
    """Measure the clock, each episode by itself."""
    steps = np.diff(rec.time)
    inside = within_episode(rec)
    good = steps[inside]
    period = float(np.median(good)) if len(good) else 1.0 / rec.rate_hz
    long = inside & (steps > GAP * period)
    even = steps[inside & ~long] - period
    clock = rec.elapsed
    gaps = tuple(
        Gap(int(row), float(clock[row]), float(steps[row]), int(round(steps[row] / period)) - 1)
        for row in np.flatnonzero(long)
    )
    return Timing(
        rate_hz=1.0 / period,
        stated_hz=float(rec.rate_hz),
        jitter=float(np.sqrt(np.mean(even**2))) if len(even) else 0.0,
        jitter_max=float(np.abs(even).max()) if len(even) else 0.0,
        gaps=gaps,
        repeated=int(held(rec.time, rec.q, inside).sum()),
        zeroed=_zeroed(rec.q),
        duration_s=float(good.sum()),
        episodes=int(np.sum(~inside)) + 1,
    )


def within_episode(rec: Recording) -> np.ndarray:
    """Mark which steps from one row to the next (n - 1,) stay within an episode."""
    if rec.episode is None:
        return np.ones(len(rec.time) - 1, bool)
    return np.diff(rec.episode) == 0


def held(time: np.ndarray, values: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Return the rows (n,) bool that repeat the row before, bit for bit in every joint, while the arm moved.

    A reading that lasts for longer than HELD is no repeat: the arm may stand. It moved if the next row that differs (at
    the end of an episode, the last one) does so by more than MOVED usual changes of a joint and QUANTA quantization
    steps: an arm that starts from rest and a coarse encoder repeat genuine readings.

    Args:
        time: (n,) s.
        values: (n, nj) readings, NaN where missing.
        inside: (n - 1,) bool, steps from one row to the next within an episode.
    """
    step = np.abs(np.diff(values, axis=0))
    same = inside & (step == 0).all(axis=1)
    if not same.any():
        return np.zeros(len(values), bool)
    quanta = np.array([quantization(column) or 0.0 for column in values.T])
    usual = np.array([np.median(column[column > 0]) if (column > 0).any() else np.inf for column in step.T])
    moved = np.any(np.nan_to_num(step) > np.maximum(QUANTA * quanta, MOVED * usual), axis=1)
    rows, ends = np.arange(len(same)), np.append(~inside, True)
    after = np.minimum.accumulate(np.where(same, len(same), rows)[::-1])[::-1]  # the next step that is not 0
    before = np.maximum.accumulate(np.where(same, -1, rows))  # the last one
    told = np.where(ends[after], before, after)
    short = time[np.where(ends[after], after, np.minimum(after + 1, len(same)))] - time[before + 1] < HELD
    return np.append(False, same & short & (told >= 0) & moved[told])


def _zeroed(q: np.ndarray) -> int:
    zero = np.ones(len(q), bool)
    for column in q.T:
        zero &= column == 0
    if zero.all() or not zero.any():
        return 0
    # Passing through zero or resting there takes small steps; a missing reading jumps by far more than the usual step.
    step = np.max([np.abs(np.nan_to_num(np.diff(column))) for column in q.T], axis=0)
    usual = max(float(np.median(step)), 1e-6)
    edges = np.flatnonzero(np.diff(zero.astype(np.int8)) != 0)
    return int(zero.sum()) if len(edges) and np.median(step[edges]) > 20 * usual else 0
