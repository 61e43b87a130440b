"""Scatter and trust of edges, of which some belong to something else."""

from __future__ import annotations

import numpy as np

from vispeg.core.rules import RULES


def noise_of(away: np.ndarray) -> float:
    """Scatter in px of edges (n,) about where they were predicted, robustly; 0.05 at least."""
    away = away[np.isfinite(away)]
    return max(1.4826 * float(np.median(np.abs(away - np.median(away)))) if len(away) else 1.0, 0.05)


def trust(away: np.ndarray, noise: float) -> np.ndarray:
    """Tukey's weights (n,) in [0, 1]; 0 where there is no edge."""
    u = np.nan_to_num(away / (RULES.edge_tukey * noise), nan=2.0)
    return np.where(np.abs(u) < 1, (1 - u * u) ** 2, 0.0)
