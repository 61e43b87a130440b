"""The kinematics of a serial arm as a product of exponentials, with joint screws computed from flange poses.

The flange's pose in the base is `exp(S_1 q_1) .. exp(S_n q_n) F(0)`, with S_j the screw of joint j at q = 0.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.render.calibration.rigid import from_quaternion, inverse

TRIED = 1.0  # rad by which a joint is turned to find its screw


class Screws:
    """Forward kinematics of many postures at once.

    Args:
        flange: function from angles (n, nj) rad to flange poses (n, 7) in the base, m and quaternion w x y z.
        joints: number of joints.
    """

    def __init__(self, flange: Callable[[np.ndarray], np.ndarray], joints: int):
        poses = flange(np.concatenate([np.zeros((1, joints)), TRIED * np.eye(joints)]))
        at = from_quaternion(poses[:, :3], poses[:, 3:])
        self.home = at[0]
        moved = at[1:] @ inverse(self.home)  # exp(S_j)
        self.axis = Rotation.from_matrix(moved[:, :3, :3]).as_rotvec() / TRIED  # (nj, 3), unit
        cross = _cross(self.axis)
        step = TRIED * np.eye(3) + (1 - np.cos(TRIED)) * cross + (TRIED - np.sin(TRIED)) * cross @ cross
        self.moment = np.linalg.solve(step, moved[:, :3, 3, None])[..., 0]  # (nj, 3) m
        self.cross = cross

    def poses(self, q: np.ndarray) -> np.ndarray:
        """Return base_T_flange (n, 4, 4) at angles (n, nj) rad."""
        out = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for j in range(len(self.axis)):
            sine, cosine = np.sin(q[:, j])[:, None, None], np.cos(q[:, j])[:, None, None]
            angle, square = q[:, j][:, None, None], self.cross[j] @ self.cross[j]
            turn = np.zeros((len(q), 4, 4))
            turn[:, :3, :3] = np.eye(3) + sine * self.cross[j] + (1 - cosine) * square
            path = angle * np.eye(3) + (1 - cosine) * self.cross[j] + (angle - sine) * square
            turn[:, :3, 3] = path @ self.moment[j]
            turn[:, 3, 3] = 1.0
            out = out @ turn
        return out @ self.home


def _cross(axis: np.ndarray) -> np.ndarray:
    """Return the matrices (n, 3, 3) of the cross product with axes (n, 3)."""
    out = np.zeros((len(axis), 3, 3))
    x, y, z = axis.T
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -z, y, -x
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = z, -y, x
    return out
