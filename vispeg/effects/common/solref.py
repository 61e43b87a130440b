"""Stiffness and damping of contacts, of which MuJoCo's `solref` has two forms.

Both state a stiffness K in 1/s^2 and a damping B in 1/s, per unit of mass. The standard form is a time constant T > 0
and a damping ratio z > 0, with `B = 2 / T` and `K = 1 / (T z)^2`. The direct form is (-K, -B), and K or B may be zero.
The impedance acts on K and B alike, so either form converts exactly and needs no mass. Only the safeguard differs:
MuJoCo keeps T, but not 2 / B, above two physics steps. So what is written keeps its form. Source: MuJoCo 4.0 manual,
Modeling, Solver parameters, Reference.
"""

from __future__ import annotations

import numpy as np


def springs(solref: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffness K (...) in 1/s^2 and damping B (...) in 1/s of `solref` (..., 2)."""
    first, second = np.moveaxis(solref, -1, 0)
    with np.errstate(divide="ignore"):  # of the form that a row does not have; without damping `0.0 - second` is not -0
        return np.where(first > 0, (first * second) ** -2.0, -first), np.where(first > 0, 2 / first, 0.0 - second)


def damping_ratio(solref: np.ndarray) -> np.ndarray:
    """Return the damping ratio `B / (2 sqrt(K))` (...) of `solref` (..., 2)."""
    stiffness, damping = springs(solref)
    return np.where(solref[..., 0] > 0, solref[..., 1], damping / (2 * np.sqrt(stiffness)))


def times(solref: np.ndarray, stiffness: np.ndarray | float = 1.0, damping: np.ndarray | float = 1.0) -> np.ndarray:
    """Return `solref` (..., 2), in the same form, of `stiffness` (> 0) times K and `damping` (> 0) times B."""
    first, second = np.moveaxis(solref, -1, 0)
    stiffness, damping = np.broadcast_arrays(stiffness, damping)
    standard = np.stack([first / damping, second * damping / np.sqrt(stiffness)], -1)
    return np.where(solref[..., :1] > 0, standard, np.stack([first * stiffness, second * damping], -1))
