"""Single bad readings: an angle that jumps away for a sample or two and comes back, as no joint can."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.recordings.checks.quality import quantization

WIDTH = 5  # samples of the running median: it does not see bursts of one or two
SIGMAS = 12.0  # of the usual distance from the running median
LOCAL = 5.0  # times the usual step nearby: a fast joint takes large steps all the time
LEAST = 1e-3  # rad
QUANTA = 3.0
NEAR = 51  # samples about a reading that say what a usual step is


@dataclass(frozen=True)
class Spike:
    """One bad reading: its row, its time in s, and how far it lies off its neighbours, rad."""

    row: int
    time: float
    size: float


def spikes(time: np.ndarray, q: np.ndarray) -> tuple[Spike, ...]:
    """Find readings of one joint that stand off their neighbours as no motion can, in order of rows.

    A reading counts if it is further from the running median over five samples than twelve standard deviations of that
    distance, than five usual steps nearby, than three steps of a coarse encoder, and than 1 mrad (Hampel's filter, kept
    from taking fast turns for outliers).

    Args:
        time: (n,) s.
        q: (n,) rad, NaN where missing.
    """
    from scipy.ndimage import median_filter

    rows = np.flatnonzero(np.isfinite(q))
    if len(rows) < 2 * WIDTH:
        return ()
    x = q[rows]
    off = x - median_filter(x, WIDTH, mode="nearest")
    far = np.abs(off)
    least = max(SIGMAS * 1.4826 * float(np.median(far[far > 0])) if (far > 0).any() else 0.0, LEAST)
    suspects = np.flatnonzero(far > least)
    if not len(suspects):
        return ()
    least = max(least, QUANTA * (quantization(q) or 0.0))
    step = np.abs(np.diff(x))
    out = []
    for k in suspects[far[suspects] > least]:
        nearby = step[max(k - NEAR, 0) : k + NEAR]
        if far[k] > LOCAL * max(float(np.quantile(nearby, 0.8)), 1e-12):
            out.append(Spike(int(rows[k]), float(time[rows[k]]), float(off[k])))
    return tuple(out)


def without(q: np.ndarray, bad: tuple[Spike, ...]) -> np.ndarray:
    """Give a copy of q (n,) in which the bad readings are missing."""
    out = q.copy()
    out[[spike.row for spike in bad]] = np.nan
    return out
