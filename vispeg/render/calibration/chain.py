"""The differences between the flange poses of a robot and of a camera, weighted by the errors of both.

Every view gives the pose C_i of the board in the camera, with a covariance from its pixels. With X and Z as in
`hand_eye.py`, it predicts the flange's pose on the base,

    eye in hand   F_i = Z C_i^-1 X^-1        eye to base   F_i = X C_i Z^-1,

which is compared with the pose that the robot reports. The difference (m, rad) has the covariance

    S_i = diag(s_t^2 I, s_r^2 I) + J_i cov(C_i) J_i^T,

where s_t and s_r are the standard deviations of the robot's own errors. To first order this is the reprojection error
with a free, penalised error of the robot in every pose, after the board poses are eliminated. Plain reprojection is the
case of an exact robot, s_t = s_r = 0. With a real arm, whose errors of millimetres are far larger than a pixel, plain
reprojection would weight the views by the apparent size of the board.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.render.calibration.board import Board
from vispeg.render.calibration.detect import View
from vispeg.render.calibration.intrinsics import Intrinsics
from vispeg.render.calibration.rigid import inverse, move, shifted

STEP = 1e-6  # step of the finite differences, m and rad: far above rounding errors, far below any curvature
STEPS = STEP * np.concatenate([np.eye(6), -np.eye(6)])
FLOOR = np.array([1e-5, 1e-5])  # least robot errors, m and rad: no arm is better, and the weights stay finite


class Chain:
    """Differences between the flange poses of the camera and those of the robot, as a function of X and Z.

    Args:
        board_poses: camera_T_board of each view, shape (n, 4, 4).
        noise: covariance of `board_poses`, shape (n, 6, 6): translation in the camera's frame, rotation in the board's.
        flange: base_T_flange as the robot reports it, shape (n, 4, 4).
        in_hand: whether the camera is on the flange.

    Attributes:
        robot: standard deviations of the robot's errors per axis, m and rad, shape (2,).
        whiten: matrices that turn differences into standard deviations, shape (n, 6, 6).
        trust: weight of each view, 0 to 1, shape (n,).
    """

    def __init__(self, board_poses: np.ndarray, noise: np.ndarray, flange: np.ndarray, in_hand: bool):
        self.board_poses, self.noise, self.flange, self.in_hand = board_poses, noise, flange, in_hand
        self.robot = FLOOR.copy()  # s_t in m, s_r in rad
        self.whiten = np.broadcast_to(np.eye(6), (len(board_poses), 6, 6))
        self.trust = np.ones(len(board_poses))

    def differences(self, x: np.ndarray, z: np.ndarray, board_poses: np.ndarray | None = None) -> np.ndarray:
        """Return the differences of the flange poses, camera minus robot, shape (..., n, 6).

        The first three are m along the base's axes, the last three a rotation vector in rad in the flange's axes.

        Args:
            x, z: X and Z, shape (4, 4), or a stack of them, shape (..., 1, 4, 4).
            board_poses: camera_T_board, shape (..., n, 4, 4); default: the measured ones.
        """
        board_poses = self.board_poses if board_poses is None else board_poses
        predicted = z @ inverse(board_poses) @ inverse(x) if self.in_hand else x @ board_poses @ inverse(z)
        turn = np.swapaxes(self.flange[:, :3, :3], 1, 2) @ predicted[..., :3, :3]
        turned = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec().reshape(*turn.shape[:-2], 3)
        return np.concatenate([predicted[..., :3, 3] - self.flange[:, :3, 3], turned], axis=-1)

    def weigh(self, x: np.ndarray, z: np.ndarray, trust: np.ndarray) -> None:
        """Estimate the robot's errors from the differences at X and Z, and set covariances and weights of the views.

        Args:
            x, z: X and Z, shape (4, 4).
            trust: weight of each view, 0 to 1, shape (n,).
        """
        found = self.differences(x, z)
        moved = shifted(self.board_poses, STEPS[:, None])  # (12, n, 4, 4)
        forth, back = np.split(self.differences(x, z, moved), 2)
        jacobian = np.moveaxis(forth - back, 0, -1) / (2 * STEP)  # (n, 6, 6)
        camera_noise = jacobian @ self.noise @ np.swapaxes(jacobian, 1, 2)
        freedom = 1 - 2 / len(found)  # X and Z have twelve parameters, as many as two views give equations
        variance = np.average(found**2, axis=0, weights=trust) / freedom
        excess = variance - np.average(np.diagonal(camera_noise, axis1=1, axis2=2), axis=0, weights=trust)
        self.robot = np.maximum(np.sqrt(np.maximum(excess.reshape(2, 3).mean(axis=1), 0)), FLOOR)
        total = camera_noise + np.diag(np.repeat(self.robot**2, 3))
        self.whiten = np.linalg.inv(np.linalg.cholesky(total))
        self.trust = trust

    def standard(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the differences in standard deviations, (..., n, 6); standard normal if the assumed errors hold."""
        return np.einsum("nij,...nj->...ni", self.whiten, self.differences(x, z))

    def weighted(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the standardised differences times the root of each view's weight, for least squares."""
        return np.sqrt(self.trust)[:, None] * self.standard(x, z)

    def slopes(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the central-difference derivative (6 n, 12) of `weighted`, flattened, by shifts of X, then Z."""
        by_x = self.weighted(shifted(x, STEPS)[:, None], z)
        by_z = self.weighted(x, shifted(z, STEPS)[:, None])
        both = np.concatenate([by_x[:6] - by_x[6:], by_z[:6] - by_z[6:]]) / (2 * STEP)
        return both.reshape(12, -1).T

    def board_scale(self, x: np.ndarray, z: np.ndarray) -> tuple[float, float]:
        """Return the board's size by the robot's motion, as a factor on the stated size, and its standard deviation.

        A board that is s times as large is s times as far away. The scale is one more unknown of the least-squares
        problem, linearised at the solution.
        """
        larger, smaller = self.board_poses.copy(), self.board_poses.copy()
        larger[:, :3, 3] *= 1 + STEP
        smaller[:, :3, 3] *= 1 - STEP
        forth, back = self.differences(x, z, larger), self.differences(x, z, smaller)
        column = np.sqrt(self.trust)[:, None] * np.einsum("nij,nj->ni", self.whiten, (forth - back) / (2 * STEP))
        basis = np.linalg.qr(self.slopes(x, z))[0]
        # the part that no change of X and Z can imitate
        independent = column.ravel() - basis @ (basis.T @ column.ravel())
        square = float(independent @ independent)
        return 1 - float(independent @ self.weighted(x, z).ravel()) / square, square**-0.5


def pose_noise(views: Sequence[View], board: Board, camera: Intrinsics, board_poses: np.ndarray) -> np.ndarray:
    """Return the covariance of each camera_T_board from its pixels, s^2 (J^T J)^-1, shape (n, 6, 6).

    The pixel noise s, in px, is estimated from the residuals of all views together, with six degrees of freedom per
    view taken off.
    """
    normal, squares, count = np.empty((len(views), 6, 6)), 0.0, 0
    for number, (view, pose) in enumerate(zip(views, board_poses, strict=True)):
        points = board.points[view.ids]
        moved = camera.project(move(shifted(pose, STEPS), points).reshape(-1, 3)).reshape(12, -1)
        jacobian = (moved[:6] - moved[6:]) / (2 * STEP)  # (6, 2 corners)
        normal[number] = jacobian @ jacobian.T
        squares += float(np.sum((camera.project(move(pose, points)) - view.pixels) ** 2))
        count += 2 * len(points) - 6
    return np.linalg.inv(normal) * max(squares / max(count, 1), 1e-6)
