"""Where a pixel looks: normalised coordinates, with pixel centres at integers."""

from __future__ import annotations

import numpy as np


def rays(K: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Rays x (n, H, W) and y (n, H, W) float32 at unit distance, for intrinsics K (n, 3, 3) in px. Skew is ignored."""
    K = np.asarray(K, np.float32)
    u, v = np.arange(shape[1], dtype=np.float32), np.arange(shape[0], dtype=np.float32)
    x = (u - K[:, 0, 2, None]) / K[:, 0, 0, None]  # (n, W)
    y = (v - K[:, 1, 2, None]) / K[:, 1, 1, None]  # (n, H)
    full = (len(K), *shape)
    return np.broadcast_to(x[:, None, :], full), np.broadcast_to(y[:, :, None], full)
