"""Joint-limit avoidance: a one-sided spring at either end of a joint's range, for the null space of a redundant arm."""

from __future__ import annotations

import numpy as np

ZONE = 0.1  # share of a joint's range, at either end, in which the spring acts


def potential(q: np.ndarray, limits: np.ndarray, stiffness: float) -> np.ndarray:
    """V (n,) in rad^2/s^2: `stiffness / 2` times the squared depths of the joints q (n, nj) in their zones.

    As Khatib's artificial potentials (Int. J. Robotics Research 5(1), 1986, section 6) it is 0 outside a zone, but
    quadratic inside, so that the pull begins at 0 and stays finite beyond the limit.
    """
    low, high = depth(q, limits)
    return 0.5 * stiffness * (low**2 + high**2).sum(axis=1)


def away(q: np.ndarray, limits: np.ndarray, stiffness: float) -> np.ndarray:
    """Joint acceleration (n, nj) rad/s^2 away from the limits (nj, 2) rad: the negative gradient of `potential`."""
    low, high = depth(q, limits)
    return stiffness * (low - high)


def depth(q: np.ndarray, limits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How deep each joint is in its lower and its upper zone, (n, nj) rad each; 0 for a joint without limits."""
    low, high = limits.T
    bounded = np.isfinite(low) & np.isfinite(high)
    low, high = np.where(bounded, low, 0.0), np.where(bounded, high, 0.0)
    zone = ZONE * (high - low)
    into = np.maximum(low + zone - q, 0.0), np.maximum(q - high + zone, 0.0)
    return np.where(bounded, into[0], 0.0), np.where(bounded, into[1], 0.0)
