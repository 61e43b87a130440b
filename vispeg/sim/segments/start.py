"""Where and how fast a recorded motion begins, from noisy angles: what a slow loop remembers for seconds."""

from __future__ import annotations

import numpy as np

DEGREE = 3  # of the polynomial that is read at its left end
WINDOWS = (0.6, 0.42, 0.3, 0.21, 0.15, 0.1, 0.07)  # s, longest first: it has the least noise
SUSPECT = 6.0  # drop of chi-squared by two more degrees that betrays a window too long (95 % of pure noise stay under)


def start_state(time: np.ndarray, q: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle (nj,) rad and velocity (nj,) rad/s at `time[0]`.

    A cubic is fitted to the longest window that two more degrees would not fit significantly better (a quintic to the
    shortest if there is none). Its end has a velocity error of about 35 sigma / (T sqrt n), where a smoother that is
    pinned to the first reading keeps that reading's whole noise.

    Args:
        time: (n,) s, increasing.
        q: (n, nj) rad, without gaps.
        sigma: (nj,) rad, white noise.
    """
    fits = [_one(time - time[0], column, s) for column, s in zip(q.T, sigma, strict=True)]
    return np.array([f[0] for f in fits]), np.array([f[1] for f in fits])


def _one(time: np.ndarray, q: np.ndarray, sigma: float) -> tuple[float, float]:
    best = (float(q[0]), 0.0)
    for span in WINDOWS:
        n = int(np.searchsorted(time, span, side="right"))
        if n < 2 * (DEGREE + 3) or time[-1] < span:
            continue
        t, y = time[:n] / time[n - 1], q[:n] - q[0]
        fits = [np.polynomial.Legendre.fit(t, y, degree, domain=[0.0, 1.0]) for degree in (DEGREE, DEGREE + 2)]
        misfit = [np.sum((y - fit(t)) ** 2) for fit in fits]
        enough = misfit[0] - misfit[1] < SUSPECT * sigma**2
        fit = fits[0 if enough else 1]  # the shortest window, too, may be too long for a cubic
        best = float(q[0] + fit(0.0)), float(fit.deriv()(0.0) / time[n - 1])
        if enough:
            break
    return best
