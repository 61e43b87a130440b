"""Convert rotation matrices to quaternions."""

from __future__ import annotations

import numpy as np


def quaternion(matrix: np.ndarray) -> np.ndarray:
    """Return the unit quaternions (..., 4) w x y z, w >= 0, of rotation matrices (..., 3, 3).

    The largest of the four numbers is computed from the diagonal and the others are divided by it, so that no divisor
    is small. Source: Quaternion from rotation matrix, J. Guidance and Control 1 (3), 1978, page 223.
    """
    m = np.asarray(matrix, float)
    trace = np.trace(m, axis1=-2, axis2=-1)[..., None]
    diagonal = np.diagonal(m, axis1=-2, axis2=-1)
    square = np.concatenate([1 + trace, 1 - trace + 2 * diagonal], axis=-1)  # 4 w^2, 4 x^2, 4 y^2, 4 z^2
    skew = np.stack([m[..., 2, 1], m[..., 0, 2], m[..., 1, 0]], -1) - np.stack(  # 4 w (x, y, z)
        [m[..., 1, 2], m[..., 2, 0], m[..., 0, 1]], -1
    )
    table = m + np.swapaxes(m, -1, -2)  # 4 x y and so on, off the diagonal
    rows = np.empty((*m.shape[:-2], 4, 4))  # row i: 4 q_i q
    rows[..., 0, 1:] = rows[..., 1:, 0] = skew
    rows[..., 1:, 1:] = table
    rows[..., range(4), range(4)] = square
    best = np.take_along_axis(rows, square.argmax(-1)[..., None, None], axis=-2)[..., 0, :]
    quat = best / np.linalg.norm(best, axis=-1, keepdims=True)
    return np.where(quat[..., :1] < 0, -quat, quat)
