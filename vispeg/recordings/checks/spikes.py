"""Find isolated bad readings of a joint's angle: it jumps away for one or two samples and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.recordings.checks.quality import QUANTA, quantization

WIDTH = 5  # samples of the running median, which ignores bursts of one or two
SIGMAS = 12.0  # least deviation of a bad reading from the running median, in standard deviations of all deviations
LOCAL = 5.0  # least deviation, in usual steps between samples nearby: in fast motion all steps are large
LEAST = 1e-3  # rad, least deviation
NEAR = 51  # number of steps before and after a reading whose 80 % quantile is the usual step


@dataclass(frozen=True)
class Spike:
    """One bad reading: its row, its time in s, and its deviation from the running median, rad, with sign."""

    row: int
    time: float
    size: float


def spikes(time: np.ndarray, q: np.ndarray) -> tuple[Spike, ...]:
    """Find the bad readings of one joint, in the order of rows; none among fewer than ten readings.

    This is Hampel's filter with guards against taking fast motion for outliers. A reading is bad if its deviation from
    the running median over five readings exceeds all of: SIGMAS standard deviations, LOCAL usual steps nearby, QUANTA
    quantization steps of the encoder, and LEAST. The standard deviation is estimated from the median deviation of the
    readings that deviate at all, so that bad readings hardly change it.

    Args:
        time: (n,) s.
        q: (n,) rad, NaN where missing.
    """
    from scipy.ndimage import median_filter

    rows = np.flatnonzero(np.isfinite(q))
    if len(rows) < 2 * WIDTH:
        return ()
    x = q[rows]
    deviation = x - median_filter(x, WIDTH, mode="nearest")
    far = np.abs(deviation)
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
            out.append(Spike(int(rows[k]), float(time[rows[k]]), float(deviation[k])))
    return tuple(out)


def without(q: np.ndarray, bad: tuple[Spike, ...]) -> np.ndarray:
    """Return a copy of q (n,) with NaN for the bad readings."""
    out = q.copy()
    out[[spike.row for spike in bad]] = np.nan
    return out
