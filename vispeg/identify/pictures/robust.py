"""Robust noise and weights of edges, some of which belong to other objects."""

from __future__ import annotations

import numpy as np

from vispeg.core.rules import RULES


def noise_of(away: np.ndarray) -> float:
    """Return a robust standard deviation in px of the edges' distances (n,) from their predictions, at least 0.05."""
    away = away[np.isfinite(away)]
    return max(1.4826 * float(np.median(np.abs(away - np.median(away)))) if len(away) else 1.0, 0.05)


def trust(away: np.ndarray, noise: float) -> np.ndarray:
    """Return Tukey's biweights (n,) in [0, 1]; 0 without an edge."""
    u = np.nan_to_num(away / (RULES.edge_tukey * noise), nan=2.0)
    return np.where(np.abs(u) < 1, (1 - u * u) ** 2, 0.0)
