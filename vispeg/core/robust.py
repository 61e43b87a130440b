"""Robust statistics, which a few outliers hardly change."""

from __future__ import annotations

import numpy as np

NORMAL = 1.4826  # standard deviation of a normal variable over its median absolute deviation


def spread(values: np.ndarray) -> float:
    """Return a robust standard deviation of values (n,) about their median, by the median absolute deviation.

    The same as `scipy.stats.median_abs_deviation(scale="normal")`, without an import of scipy.stats, for the rendering
    of datasets.
    """
    return NORMAL * float(np.median(np.abs(values - np.median(values))))


def huber(residual: np.ndarray, far: float) -> np.ndarray:
    """Return residuals whose squares grow linearly beyond `far` (Huber, Annals of Mathematical Statistics 35, 1964)."""
    size = np.abs(residual)
    return np.where(size <= far, residual, np.sign(residual) * np.sqrt(far * np.maximum(2 * size - far, 0.0)))
