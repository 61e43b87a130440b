"""Examine sample times: rate, jitter, gaps, and readings that were lost and replaced by repeats or zeros."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.recordings.recording import Recording

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
        repeated: rows bit-identical to the previous row while the arm moved (a lost reading that was held).
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
        repeated=_repeated(rec, inside),
        zeroed=_zeroed(rec.q),
        duration_s=float(good.sum()),
        episodes=int(np.sum(~inside)) + 1,
    )


def within_episode(rec: Recording) -> np.ndarray:
    """Mark which steps from one row to the next (n - 1,) stay within an episode."""
    if rec.episode is None:
        return np.ones(len(rec.time) - 1, bool)
    return np.diff(rec.episode) == 0


def _repeated(rec: Recording, inside: np.ndarray) -> int:
    """Count repeated rows: an arm that moves before and after a row cannot read exactly the same in every joint."""
    same, step = inside.copy(), np.zeros(len(inside))
    for column in rec.q.T:
        change = np.diff(column)
        same &= change == 0
        step = np.maximum(step, np.abs(np.nan_to_num(change)))
    for column in () if rec.tau is None else rec.tau.T:
        same &= np.diff(column) == 0
    # The steps before and after must exceed a typical one: a coarse encoder on a slow arm repeats genuine readings.
    usual = np.median(step[step > 0]) if np.any(step > 0) else np.inf
    large = np.pad((step >= usual).astype(np.int8), 1)
    moving = large[:-2] + large[2:] == 2
    return int(np.sum(same & moving))


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
