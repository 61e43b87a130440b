"""The viewing rays of pixels: normalised coordinates, with pixel centres at integers."""

from __future__ import annotations

from functools import lru_cache

import numpy as np


def rays(K: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y and 1 + x^2 + y^2 of the rays (x, y, 1), each (H, W) float32, for intrinsics K (3, 3) in px.

    Skew is ignored. The arrays are read-only, because they are cached for the next frame.
    """
    return _rays(float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), shape)


@lru_cache(maxsize=16)
def _rays(fx: float, fy: float, cx: float, cy: float, shape: tuple[int, int]):
    u, v = np.arange(shape[1]), np.arange(shape[0])[:, None]
    x, y = (np.broadcast_to(line, shape).astype(np.float32) for line in ((u - cx) / fx, (v - cy) / fy))
    out = x, y, 1 + x * x + y * y
    for array in out:
        array.flags.writeable = False
    return out
