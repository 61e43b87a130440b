"""Rigid transforms as 4x4 matrices: `a_T_b` takes coordinates in frame b to coordinates in frame a, metres."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation


def transform(rotation_vector: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Transform (..., 4, 4) of rotation vectors (..., 3) rad and translations (..., 3) m."""
    turn = np.asarray(rotation_vector, float)
    out = np.zeros((*turn.shape[:-1], 4, 4))
    out[..., :3, :3] = Rotation.from_rotvec(turn.reshape(-1, 3)).as_matrix().reshape(*turn.shape[:-1], 3, 3)
    out[..., :3, 3] = translation
    out[..., 3, 3] = 1.0
    return out


def from_quaternion(translation: np.ndarray, wxyz: np.ndarray) -> np.ndarray:
    """Transform (..., 4, 4) of translations (..., 3) m and unit quaternions (..., 4), w first."""
    return transform(Rotation.from_quat(wxyz, scalar_first=True).as_rotvec(), translation)


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Give the inverse of rigid transforms, shape (..., 4, 4)."""
    out = np.zeros_like(matrix)
    turned = np.swapaxes(matrix[..., :3, :3], -1, -2)
    out[..., :3, :3] = turned
    out[..., :3, 3] = -np.einsum("...ij,...j->...i", turned, matrix[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def difference(matrix: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """From a reference to a transform, shape (6,): m in the outer frame, then rad in the inner."""
    turn = reference[:3, :3].T @ matrix[:3, :3]
    return np.concatenate([matrix[:3, 3] - reference[:3, 3], Rotation.from_matrix(turn).as_rotvec()])


def angles(rotations: np.ndarray) -> np.ndarray:
    """Rotation angles (n,), rad, of matrices (n, 3, 3)."""
    return Rotation.from_matrix(rotations).magnitude()


def move(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) taken through transforms (..., 4, 4): shape (..., n, 3)."""
    return points @ np.swapaxes(pose[..., :3, :3], -1, -2) + pose[..., None, :3, 3]


def shifted(pose: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Give the inverse of `difference`: transforms (..., 4, 4) moved by (..., 6), m outside and rad inside."""
    out = pose @ transform(by[..., 3:], np.zeros(3))
    out[..., :3, 3] += by[..., :3]
    return out
