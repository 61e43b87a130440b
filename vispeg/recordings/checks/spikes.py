"""Find isolated bad readings: the angle jumps away for one or two samples and back, faster than a joint can move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.recordings.checks.quality import quantization

WIDTH = 5  # samples of the running median, which ignores bursts of one or two
SIGMAS = 12.0  # least deviation from the running median, in standard deviations of that deviation
LOCAL = 5.0  # least deviation, in usual steps nearby: a fast joint always takes large steps
LEAST = 1e-3  # rad, least deviation
QUANTA = 3.0
NEAR = 51  # samples around a reading from which the usual step is taken


@dataclass(frozen=True)
class Spike:
    """One bad reading: its row, its time in s, and its deviation from its neighbours, rad."""

    row: int
    time: float
    size: float


def spikes(time: np.ndarray, q: np.ndarray) -> tuple[Spike, ...]:
    """Find readings of one joint that deviate from their neighbours more than any motion can, in order of rows.

    This is Hampel's filter with guards against taking fast motion for outliers. The deviation from the running median
    over five samples must exceed all of: twelve standard deviations of that deviation, five usual steps nearby, three
    quantization steps of the encoder, and 1 mrad.

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
    """Return a copy of q (n,) with NaN for the bad readings."""
    out = q.copy()
    out[[spike.row for spike in bad]] = np.nan
    return out
