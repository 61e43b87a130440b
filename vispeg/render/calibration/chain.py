"""The misfit between a robot's poses and a camera's, each weighted by what is known of its errors.

Every view gives the pose C_i of the board in the camera, with a covariance from its pixels, and so says where the
flange was,

    in hand   F_i = Z C_i^-1 X^-1        to base   F_i = X C_i Z^-1,

to compare with where the robot says it was. The difference (m, rad) has the covariance

    S_i = diag(s_t^2 I, s_r^2 I) + J_i cov(C_i) J_i^T

with s_t, s_r the robot's own errors. This is the reprojection error with a free, penalised error of the robot in every
pose, the board poses eliminated to first order. Plain reprojection is the case of an exact robot, s_t = s_r = 0; with a
real arm, whose millimetres exceed a pixel's worth by far, it weighs the views by how large the board looks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.render.calibration.board import Board
from vispeg.render.calibration.detect import View
from vispeg.render.calibration.intrinsics import Intrinsics
from vispeg.render.calibration.rigid import inverse, move, shifted

STEP = 1e-6  # of the finite differences, m and rad: far above rounding, far below any curvature
STEPS = STEP * np.concatenate([np.eye(6), -np.eye(6)])
FLOOR = np.array([1e-5, 1e-5])  # m, rad: no arm is better, and the weights stay finite


class Chain:
    """Differences between the flange as the camera and as the robot have it, as a function of X and Z.

    Args:
        board_poses: camera_T_board of each view, shape (n, 4, 4).
        noise: covariance of `board_poses`, shape (n, 6, 6): translation in the camera's frame, rotation in the board's.
        flange: base_T_flange as the robot reports it, shape (n, 4, 4).
        in_hand: whether the camera is on the flange.
    """

    def __init__(self, board_poses: np.ndarray, noise: np.ndarray, flange: np.ndarray, in_hand: bool):
        self.board_poses, self.noise, self.flange, self.in_hand = board_poses, noise, flange, in_hand
        self.robot = FLOOR.copy()  # s_t m, s_r rad
        self.whiten = np.broadcast_to(np.eye(6), (len(board_poses), 6, 6))
        self.trust = np.ones(len(board_poses))

    def differences(self, x: np.ndarray, z: np.ndarray, board_poses: np.ndarray | None = None) -> np.ndarray:
        """Shape (..., n, 6): m on the base's axes, rad on the flange's; X and Z may be many, shape (..., 1, 4, 4)."""
        board_poses = self.board_poses if board_poses is None else board_poses
        predicted = z @ inverse(board_poses) @ inverse(x) if self.in_hand else x @ board_poses @ inverse(z)
        turn = np.swapaxes(self.flange[:, :3, :3], 1, 2) @ predicted[..., :3, :3]
        turned = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec().reshape(*turn.shape[:-2], 3)
        return np.concatenate([predicted[..., :3, 3] - self.flange[:, :3, 3], turned], axis=-1)

    def weigh(self, x: np.ndarray, z: np.ndarray, trust: np.ndarray) -> None:
        """Set the robot's errors to what the differences at X, Z show, and the views' covariances by them.

        Args:
            trust: weight of each view, 0 to 1, shape (n,).
        """
        now = self.differences(x, z)
        moved = shifted(self.board_poses, STEPS[:, None])  # (12, n, 4, 4)
        forth, back = np.split(self.differences(x, z, moved), 2)
        jacobian = np.moveaxis(forth - back, 0, -1) / (2 * STEP)  # (n, 6, 6)
        camera = jacobian @ self.noise @ np.swapaxes(jacobian, 1, 2)
        share = 1 - 2 / len(now)  # X and Z take what two views give
        variance = np.average(now**2, axis=0, weights=trust) / share
        excess = variance - np.average(np.diagonal(camera, axis1=1, axis2=2), axis=0, weights=trust)
        self.robot = np.maximum(np.sqrt(np.maximum(excess.reshape(2, 3).mean(axis=1), 0)), FLOOR)
        total = camera + np.diag(np.repeat(self.robot**2, 3))
        self.whiten = np.linalg.inv(np.linalg.cholesky(total))
        self.trust = trust

    def standard(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Shape (..., n, 6), without unit; standard normal where the errors are as assumed."""
        return np.einsum("nij,...nj->...ni", self.whiten, self.differences(x, z))

    def weighted(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the residuals weighted by the trust in each view, for least squares."""
        return np.sqrt(self.trust)[:, None] * self.standard(x, z)

    def slopes(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Differentiate the flat weighted differences by small shifts of X, then Z, shape (6 n, 12): central steps."""
        by_x = self.weighted(shifted(x, STEPS)[:, None], z)
        by_z = self.weighted(x, shifted(z, STEPS)[:, None])
        both = np.concatenate([by_x[:6] - by_x[6:], by_z[:6] - by_z[6:]]) / (2 * STEP)
        return both.reshape(12, -1).T

    def board_scale(self, x: np.ndarray, z: np.ndarray) -> tuple[float, float]:
        """How large the robot's motion says the board is, relative to what was given, and its standard deviation.

        A board s times as large lies s times as far, so one column more in the linear problem at the solution.
        """
        larger, smaller = self.board_poses.copy(), self.board_poses.copy()
        larger[:, :3, 3] *= 1 + STEP
        smaller[:, :3, 3] *= 1 - STEP
        forth, back = self.differences(x, z, larger), self.differences(x, z, smaller)
        column = np.sqrt(self.trust)[:, None] * np.einsum("nij,nj->ni", self.whiten, (forth - back) / (2 * STEP))
        basis = np.linalg.qr(self.slopes(x, z))[0]
        independent = column.ravel() - basis @ (basis.T @ column.ravel())  # what X and Z cannot do as well
        square = float(independent @ independent)
        return 1 - float(independent @ self.weighted(x, z).ravel()) / square, square**-0.5


def pose_noise(views: Sequence[View], board: Board, camera: Intrinsics, board_poses: np.ndarray) -> np.ndarray:
    """Covariance of each camera_T_board from its pixels, s^2 (J^T J)^-1, shape (n, 6, 6).

    s is one for all views: their pooled residual, six degrees of freedom a view less.
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
