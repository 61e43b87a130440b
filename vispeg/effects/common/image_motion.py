"""How the camera's motion relative to what each pixel shows moves the pixels of an image.

The motion (v, w) relative to the body that a pixel of depth z shows moves the pixel by
du/dt = fx (-vx / z + x vz / z + x y wx - (1 + x^2) wy + y wz) and likewise along the other axis, where x, y are its
normalised coordinates (Longuet-Higgins and Prazdny, The interpretation of a moving retinal image, 1980).
"""

from __future__ import annotations

import numpy as np

from vispeg.effects.common.disparity import disparity, truth
from vispeg.effects.common.rays import rays


def nearness(frame, row: int) -> np.ndarray:
    """Return 1 / depth (H, W) of an image as rendered, 1/m; 0 where nothing is seen or depth is not known."""
    if frame.truth is None and frame.depth is None:
        return np.zeros(frame.shape, np.float32)
    return disparity(truth(frame)[row], np.float32(1))


def image_flow(frame, row: int, near: np.ndarray) -> np.ndarray:
    """Return how fast (H, W, 3) what each pixel shows moves: across and down in px/s, and away in m/s.

    Args:
        frame, row: the image.
        near: (H, W) as by `nearness`; what has 0 counts as far away, and moves by the camera's rotation alone.
    """
    x, y, _ = rays(frame.K[row], frame.shape)
    twist = frame.velocity[row] if frame.bodies is None else frame.twists[row][frame.bodies[row]]
    vx, vy, vz, wx, wy, wz = np.moveaxis(twist.astype(np.float32), -1, 0)
    du = (-vx + x * vz) * near + x * y * wx - (1 + x * x) * wy + y * wz
    dv = (-vy + y * vz) * near + (1 + y * y) * wx - x * y * wy - x * wz
    z = np.divide(1, near, out=np.zeros_like(near), where=near > 0)
    return np.stack([du * frame.K[row, 0, 0], dv * frame.K[row, 1, 1], (x * wy - y * wx) * z - vz], -1).astype(
        np.float32
    )


def arriving(shift: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Return by how much (H, W, 3) what is then seen in each pixel has moved.

    Where nothing arrives, it is the pixel's own shift. It is 0 if a nearer surface is seen at the place from which that
    shift leads to the pixel.

    Args:
        shift: (H, W, 3) by how much what each pixel shows moves: px across and down, and m.
        near: (H, W) 1/m; of the surfaces that arrive in a pixel the one with the largest value is seen.
    """
    height, width = near.shape
    u, v, moves = np.arange(width), np.arange(height)[:, None], shift.reshape(-1, 3)
    left = np.clip(np.rint(u - shift[..., 0]), 0, width - 1).astype(np.int32)
    above = np.clip(np.rint(v - shift[..., 1]), 0, height - 1).astype(np.int32)
    unreached = np.where((near < near[above, left])[..., None], np.float32(0), shift)
    # Each pixel is written to all pixels around its new place, four unless it lies on a row or column. The picture has
    # margins of two pixels for what leaves it.
    wide = width + 4
    far_first = np.argsort(near, axis=None, kind="stable").astype(np.int32)
    across, down = (
        [np.clip(side(to), -2, n + 1).astype(np.int32).ravel()[far_first] + 2 for side in (np.floor, np.ceil)]
        for to, n in ((u + shift[..., 0], width), (v + shift[..., 1], height))
    )
    at = np.stack([y * wide + x for y in down for x in across], axis=1)
    seen = np.full((height + 4) * wide, -1, np.int32)
    seen[at] = far_first[:, None]  # of several assignments to a pixel the last one stays: that of the nearest
    seen = seen.reshape(height + 4, wide)[2:-2, 2:-2]
    return np.where((seen >= 0)[..., None], moves[seen], unreached)
