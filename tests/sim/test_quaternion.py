"""Rotation matrices to quaternions: MuJoCo's own conversion is the oracle."""

import mujoco
import numpy as np

from vispeg.core.seeds import stream
from vispeg.sim.nominal import quat


def test_agrees_with_mujoco_for_every_branch():
    """Random rotations and half turns about each axis, where the real part vanishes."""
    q = stream(0, "quaternions").normal(size=(500, 4))
    q = np.concatenate([q, np.eye(4), 1e-9 + np.eye(4)])
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    mats, expected = np.empty((len(q), 9)), np.empty((len(q), 4))
    for one, mat, out in zip(q, mats, expected, strict=True):
        mujoco.mju_quat2Mat(mat, one)
        mujoco.mju_mat2Quat(out, mat)
    np.testing.assert_allclose(quat(mats), expected, atol=1e-14)
    np.testing.assert_array_equal(quat(mats.reshape(-1, 3, 3)), quat(mats))
