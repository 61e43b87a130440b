"""Lines of plots, thinned such that peaks and gaps stay."""

from __future__ import annotations

import numpy as np


def gaps(values: np.ndarray) -> np.ndarray:
    """Return the first missing row of each gap in values (n,), where NaN and infinity are missing.

    A gap is longer than the values' usual distance: a line may have a value in every tenth row only.
    """
    rows = np.flatnonzero(np.isfinite(values))
    steps = np.diff(rows)
    return rows[:-1][steps > 1.5 * np.quantile(steps, 0.9)] + 1 if steps.size else rows[:0]


def thin(time: np.ndarray, values: np.ndarray, most: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """Thin (n,) arrays to `most` points: lowest and highest value of every interval, and NaN in gaps."""
    values = np.where(np.isfinite(values), values, np.nan)
    rows = np.union1d(np.flatnonzero(np.isfinite(values)), gaps(values))
    if len(rows) > most:
        keep = []
        for part in np.array_split(rows, most // 3):
            inside = values[part]
            keep += [part[np.nanargmin(inside)], part[np.nanargmax(inside)], *part[np.isnan(inside)][:1]]
        rows = np.unique(keep)
    return time[rows], values[rows]


def thinned(values: np.ndarray, most: int) -> np.ndarray:
    """Thin (n, k) to at most `most` rows: of every interval the lowest and highest value, and NaN where a gap is."""
    if len(values) <= most:
        return values
    start, end = _intervals(len(values), most)
    rows = np.minimum(start[:, None] + np.arange((end - start).max()), end[:, None] - 1)
    missing = np.zeros(values.shape, bool)
    for column, signal in zip(missing.T, values.T, strict=True):
        column[gaps(signal)] = True
    parts, missing = values[rows], missing[rows]
    low = np.where(np.isfinite(parts), parts, np.inf).argmin(axis=1)
    high = np.where(np.isfinite(parts), parts, -np.inf).argmax(axis=1)
    gap = np.where(missing.any(axis=1), missing.argmax(axis=1), low)
    at = np.sort(np.stack([low, high, gap], axis=1), axis=1)
    return np.take_along_axis(parts, at, axis=1).reshape(-1, values.shape[1])


def thinned_time(time: np.ndarray, most: int) -> np.ndarray:
    """Thin times (n,) to match the rows of `thinned`: three per interval, evenly spaced."""
    if len(time) <= most:
        return time
    start, end = _intervals(len(time), most)
    sixth = (end - start) // 6
    return np.stack([time[start + sixth], time[(start + end - 1) // 2], time[end - 1 - sixth]], axis=1).ravel()


def _intervals(n: int, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return first row of each of `most // 3` intervals, and the row after its last; together they are all n rows."""
    edges = np.arange(most // 3 + 1) * n // (most // 3)
    return edges[:-1], edges[1:]
