"""95 % intervals that include the robot's errors, by a jackknife over views or groups of views.

The covariance (J^T J)^-1 s^2 from pixel residuals is far too small: an arm's poses are off by millimetres and a board
is not quite flat. Both errors are common to all corners of a view, so corners are not independent. The jackknife
treats views as the independent samples: over G groups of views,

    cov = (G - 1) / G  sum_g (q_g - q)(q_g - q)^T,    half width = t_{0.975, G - 2} sqrt(diag cov)

(Efron and Tibshirani 1993, chapter 11; Shao and Wu 1989 for groups). Each estimate is repeated without the group,
including intrinsics that come from the same views, so that their errors are included. There is one degree of freedom
less than in the textbook: X and Z have twelve parameters and each view gives six equations, so the estimate uses up
two views.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

MAX_GROUPS = 20


def groups(count: int) -> list[np.ndarray]:
    """Return the groups of views to leave out: single views up to `MAX_GROUPS`, else interleaved groups of indices."""
    number = min(count, MAX_GROUPS)
    return [np.arange(count)[first::number] for first in range(number)]


def leave_out(count: int, estimate: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the shifts of an estimate when each group is left out, shape (G, p).

    Args:
        count: number of views.
        estimate: function from the indices of the kept views to the estimate's shift, shape (p,), from the one with
            all views.
    """
    every = np.arange(count)
    return np.stack([estimate(np.setdiff1d(every, out)) for out in groups(count)])


def half_widths(shifts: np.ndarray) -> np.ndarray:
    """Return half widths of the 95 % intervals, shape (p,), from jackknife shifts (G, p)."""
    from scipy.stats import t

    number = len(shifts)
    return t.ppf(0.975, number - 2) * np.sqrt((number - 1) / number * np.sum(shifts**2, axis=0))
