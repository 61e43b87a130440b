"""Quaternions of rotation matrices: against two other libraries, half turns included, any leading axes."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vispeg.core.rotation import quaternion


def turns():
    rng = np.random.default_rng(0)
    some = Rotation.random(200, rng).as_matrix()
    half = Rotation.from_rotvec(np.pi * np.vstack([np.eye(3), [[0.6, 0.8, 0.0], [0.0, -0.6, 0.8]]])).as_matrix()
    tiny = Rotation.from_rotvec([[1e-9, 0, 0], [0, np.pi - 1e-9, 0], [0, 0, 0]]).as_matrix()
    return np.concatenate([some, half, tiny])


def test_a_quaternion_turns_as_its_matrix_does():
    found = quaternion(turns())
    assert np.allclose(np.linalg.norm(found, axis=1), 1, atol=1e-15) and (found[:, 0] >= 0).all()
    assert np.allclose(Rotation.from_quat(found, scalar_first=True).as_matrix(), turns(), atol=1e-14)
    for matrix, quat in zip(turns(), found, strict=True):
        other = np.empty(4)
        mujoco.mju_mat2Quat(other, matrix.ravel())
        assert abs(other @ quat) == pytest.approx(1, abs=1e-14)


def test_leading_axes_stay():
    many = turns()[:12].reshape(3, 4, 3, 3)
    assert np.array_equal(quaternion(many).reshape(12, 4), quaternion(turns()[:12]))
    assert np.array_equal(quaternion(np.eye(3)), [1, 0, 0, 0])
