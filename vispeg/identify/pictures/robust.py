"""Robust noise, weights and fits of edges, some of which belong to other objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.robust import spread
from vispeg.core.rules import RULES


def noise_of(away: np.ndarray) -> float:
    """Return a robust standard deviation in px of the edges' distances (n,) from their predictions, at least 0.05."""
    away = away[np.isfinite(away)]
    return max(spread(away) if len(away) else 1.0, 0.05)


def trust(away: np.ndarray, noise: float) -> np.ndarray:
    """Return Tukey's biweights (n,) in [0, 1]; 0 without an edge."""
    u = np.nan_to_num(away / (RULES.edge_tukey * noise), nan=2.0)
    return np.where(np.abs(u) < 1, (1 - u * u) ** 2, 0.0)


def fit(slopes: np.ndarray, away: np.ndarray, scales: Sequence[float], precision: np.ndarray | float) -> np.ndarray:
    """Return the unknowns (k,) of most of n readings, `away = slopes @ unknowns`, by Tukey's weights.

    Args:
        slopes: (n, k).
        away: (n,) readings.
        scales: scatter of the readings in successive rounds, from a wide one to a narrow one.
        precision: of the unknowns about 0 a priori, one over a variance; may differ by round.
    """
    unknowns = np.zeros(slopes.shape[1])
    for scale, prior in zip(scales, np.broadcast_to(precision, len(scales)), strict=True):
        weighted = slopes.T * (trust(away - slopes @ unknowns, scale) / scale**2)
        unknowns = np.linalg.solve(weighted @ slopes + prior * np.eye(slopes.shape[1]), weighted @ away)
    return unknowns
