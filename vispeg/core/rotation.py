"""Convert rotation matrices to quaternions."""

from __future__ import annotations

import numpy as np


def quaternion(matrix: np.ndarray) -> np.ndarray:
    """Return the unit quaternions (..., 4) w x y z, w >= 0, of rotation matrices (..., 3, 3).

    The matrix gives the products 4 q_i q_j. Row i of these is 4 q_i q; the row with the largest q_i^2 is normalised, so
    that no divisor is small. Source: Quaternion from rotation matrix, J. Guidance and Control 1 (3), 1978, page 223.
    """
    m = np.asarray(matrix, float)
    trace = np.trace(m, axis1=-2, axis2=-1)[..., None]
    diagonal = np.diagonal(m, axis1=-2, axis2=-1)
    squares = np.concatenate([1 + trace, 1 - trace + 2 * diagonal], axis=-1)  # 4 w^2, 4 x^2, 4 y^2, 4 z^2
    lower = np.stack([m[..., 2, 1], m[..., 0, 2], m[..., 1, 0]], -1)
    upper = np.stack([m[..., 1, 2], m[..., 2, 0], m[..., 0, 1]], -1)
    rows = np.empty((*m.shape[:-2], 4, 4))
    rows[..., 0, 1:] = rows[..., 1:, 0] = lower - upper  # 4 w x, 4 w y, 4 w z
    rows[..., 1:, 1:] = m + np.swapaxes(m, -1, -2)  # 4 x y and so on, off the diagonal
    rows[..., range(4), range(4)] = squares
    largest = np.take_along_axis(rows, squares.argmax(-1)[..., None, None], axis=-2)[..., 0, :]
    quat = largest / np.linalg.norm(largest, axis=-1, keepdims=True)
    return np.where(quat[..., :1] < 0, -quat, quat)
