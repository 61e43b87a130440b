"""The noise of a recording: as stated, or estimated from what no arm can do."""

from __future__ import annotations

import numpy as np

from vispeg.recordings.recording import Recording


def highpass_sigma(values: np.ndarray) -> np.ndarray:
    """1-sigma white noise of each column of (n, nj), from fourth differences: motion is smooth over five samples.

    The fourth difference of white noise has variance 70 sigma^2 (sum of squared binomials 1 4 6 4 1); the median
    absolute deviation keeps jumps and reversals out.
    """
    diff = np.diff(values, 4, axis=0)
    mad = np.nanmedian(np.abs(diff - np.nanmedian(diff, axis=0)), axis=0)
    return 1.4826 * mad / np.sqrt(70.0)


def noise_of(rec: Recording) -> dict[str, np.ndarray]:
    """1-sigma per joint (nj,) of `q` (rad) and `tau` (N m): stated where it is, else estimated."""
    out = {}
    for name, least in (("q", 1e-7), ("tau", 1e-3)):
        values = getattr(rec, name)
        if values is None:
            continue
        if name in rec.noise:
            out[name] = np.full(values.shape[1], float(rec.noise[name]))
        else:
            out[name] = np.maximum(highpass_sigma(values), least)
    return out
