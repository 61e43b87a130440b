"""Rigid transforms as 4x4 matrices: `a_T_b` converts coordinates in frame b to coordinates in frame a, in m."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation


def transform(rotation_vector: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Return the transforms (..., 4, 4) of rotation vectors (..., 3), rad, and translations (..., 3), m."""
    turn = np.asarray(rotation_vector, float)
    out = np.zeros((*turn.shape[:-1], 4, 4))
    out[..., :3, :3] = Rotation.from_rotvec(turn.reshape(-1, 3)).as_matrix().reshape(*turn.shape[:-1], 3, 3)
    out[..., :3, 3] = translation
    out[..., 3, 3] = 1.0
    return out


def from_quaternion(translation: np.ndarray, wxyz: np.ndarray) -> np.ndarray:
    """Return the transforms (..., 4, 4) of translations (..., 3), m, and unit quaternions (..., 4), w first."""
    return transform(Rotation.from_quat(wxyz, scalar_first=True).as_rotvec(), translation)


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the inverses of rigid transforms, shape (..., 4, 4)."""
    out = np.zeros_like(matrix)
    turned = np.swapaxes(matrix[..., :3, :3], -1, -2)
    out[..., :3, :3] = turned
    out[..., :3, 3] = -np.einsum("...ij,...j->...i", turned, matrix[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def difference(matrix: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the difference of a transform a_T_b from a reference, shape (6,): m in frame a, then rad in frame b."""
    turn = reference[:3, :3].T @ matrix[:3, :3]
    return np.concatenate([matrix[:3, 3] - reference[:3, 3], Rotation.from_matrix(turn).as_rotvec()])


def angles(rotations: np.ndarray) -> np.ndarray:
    """Return the rotation angles (n,), rad, of rotation matrices (n, 3, 3)."""
    return Rotation.from_matrix(rotations).magnitude()


def move(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Transform points (n, 3) by transforms (..., 4, 4); return shape (..., n, 3)."""
    return points @ np.swapaxes(pose[..., :3, :3], -1, -2) + pose[..., None, :3, 3]


def shifted(pose: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Return transforms a_T_b (..., 4, 4) shifted by (..., 6), m in frame a and rad in frame b; undoes `difference`."""
    out = pose @ transform(by[..., 3:], np.zeros(3))
    out[..., :3, 3] += by[..., :3]
    return out
