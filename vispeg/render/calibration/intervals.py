"""95 % intervals that know the robot's errors: leaving out one view (or one group of views) at a time.

Pixel noise alone says little about a result: an arm's poses are off by millimetres, a board is not quite flat, and
either is the same for all corners of a view, so that the corners are not independent and (J^T J)^-1 s^2 is far too
small. The jackknife asks the views instead: over G groups of views,

    cov = (G - 1) / G  sum_g (q_g - q)(q_g - q)^T,    half width = t_{0.975, G - 2} sqrt(diag cov)

(Efron and Tibshirani 1993, chapter 11; Shao and Wu 1989 for groups). Every estimate is made anew without the group,
intrinsics too where they come from the same views, so that their errors are in it. One degree of freedom less than the
textbook's: X and Z take twelve numbers from the six that every view gives, which is two views.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

MAX_GROUPS = 20


def groups(count: int) -> list[np.ndarray]:
    """Which views to leave out together: one by one up to `MAX_GROUPS`, else interleaved groups of nearly one size."""
    number = min(count, MAX_GROUPS)
    return [np.arange(count)[first::number] for first in range(number)]


def leave_out(count: int, estimate: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Shifts of an estimate when each group is left out, shape (G, p).

    Args:
        count: number of views.
        estimate: from the kept views' indices to the shift from the estimate of all, shape (p,).
    """
    every = np.arange(count)
    return np.stack([estimate(np.setdiff1d(every, out)) for out in groups(count)])


def half_widths(shifts: np.ndarray) -> np.ndarray:
    """Half widths of the 95 % intervals, shape (p,), of jackknife shifts (G, p)."""
    from scipy.stats import t

    number = len(shifts)
    return t.ppf(0.975, number - 2) * np.sqrt((number - 1) / number * np.sum(shifts**2, axis=0))
