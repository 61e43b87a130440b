"""The camera's pose on the flange (eye in hand) or on the base (eye to base), from views and flange poses.

X is the camera's pose and Z the board's: flange_T_camera and base_T_board for eye in hand, base_T_camera and
flange_T_board for eye to base. `cv2.calibrateHandEye` gives the start from relative motions (AX = XB). Then X and Z are
refined together by a robust fit of the whole chain, which also estimates the robot's errors (`chain.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

from vispeg.core.errors import UserError
from vispeg.render.calibration.board import Board
from vispeg.render.calibration.chain import Chain, pose_noise
from vispeg.render.calibration.detect import View
from vispeg.render.calibration.intrinsics import Intrinsics, board_pose, view_error
from vispeg.render.calibration.rigid import inverse, shifted, transform

Mount = Literal["flange", "base"]
MOUNTS = ("flange", "base")
METHODS = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
MIN_POSES = 4  # three fix X and Z (two motions about different axes); leaving one out needs the fourth
MIN_TURN = np.radians(3.0)  # rad, least RMS turn about the second axis
ROUNDS = 6  # alternations between weights and solution
KNEE = 2.5  # misfit at which a view has half its weight, so that one bad pose does not decide the result


@dataclass(frozen=True)
class HandEye:
    """A hand-eye solution.

    Args:
        camera: X, shape (4, 4): pose of the camera (OpenCV's axes) on the flange or on the base.
        board: Z, shape (4, 4): pose of the board on the base or on the flange.
        std: standard deviations of X from the fit's covariance, m and rad, shape (6,).
        robot: estimated errors of the robot, RMS per axis, m and rad, shape (2,).
        pixels: reprojection error through the robot, RMS of each view, px, shape (n,).
        misfit: RMS of each view's six differences in standard deviations, shape (n,); 1 is usual, 3 suspect.
        scatter: RMS distance, m, of the board's origins, one found from each view, from their mean.
        scale: the board's size by the robot's motion, relative to the stated size, and its standard deviation.
        methods: X by the name of each closed-form method, before refinement.
    """

    camera: np.ndarray
    board: np.ndarray
    std: np.ndarray
    robot: np.ndarray
    pixels: np.ndarray
    misfit: np.ndarray
    scatter: float
    scale: tuple[float, float]
    methods: dict[str, np.ndarray]


def check_motion(flange: np.ndarray) -> None:
    """Refuse motions that do not fix the camera's pose: those with fewer than two axes of rotation.

    Args:
        flange: base_T_flange of each view, shape (n, 4, 4).

    Raises:
        UserError: there are too few poses, or turns about fewer than two axes.
    """
    if len(flange) < MIN_POSES:
        raise UserError("too few poses with the board in view", expected=f"{MIN_POSES} or more", got=len(flange))
    turns = Rotation.from_matrix(flange[:, :3, :3])
    turned = (turns.mean().inv() * turns).as_rotvec()  # (n, 3)
    spread = np.linalg.svd(turned, compute_uv=False) / np.sqrt(len(flange))
    if spread[1] < MIN_TURN:
        how = "hardly turned" if spread[0] < MIN_TURN else "turned about one axis only"
        raise UserError(
            f"the flange {how}, so the camera's pose cannot be determined",
            expected="poses turned 15 degrees or more about two different axes",
            got=f"{np.degrees(spread[0]):.1f} and {np.degrees(spread[1]):.1f} degrees RMS about the first and second",
        )


def solve(
    views: Sequence[View],
    board: Board,
    camera: Intrinsics,
    flange: np.ndarray,
    mount: Mount,
    start: HandEye | None = None,
) -> HandEye:
    """Fit the poses of the camera and of the board to views and flange poses, robustly.

    Args:
        views: the views, with one numbering of corners.
        board: the board.
        camera: the intrinsics.
        flange: base_T_flange of each view, shape (n, 4, 4), m.
        mount: what the camera is fixed to, `flange` or `base`.
        start: a nearby solution, from which to start instead of from the closed-form methods.

    Raises:
        UserError: the motion is degenerate, the mount is unknown, a board pose is not found, or the images are
            mirrored.
    """
    board_poses = np.stack([board_pose(view, board, camera) for view in views])
    noise = pose_noise(views, board, camera, board_poses)
    found = solve_poses(board_poses, noise, flange, mount, start)
    outer = flange if mount == "flange" else inverse(flange)
    path = inverse(found.camera) @ inverse(outer) @ found.board  # (n, 4, 4) camera_T_board through the robot
    pixels = [view_error(view, board, camera, pose) for view, pose in zip(views, path, strict=True)]
    return replace(found, pixels=np.array(pixels))


def solve_poses(
    board_poses: np.ndarray, noise: np.ndarray, flange: np.ndarray, mount: Mount, start: HandEye | None = None
) -> HandEye:
    """Fit the poses of the camera and of the board as `solve` does, but to poses alone; `pixels` is empty.

    Args:
        board_poses: camera_T_board, (n, 4, 4), m.
        noise: their covariances as for `Chain`, (n, 6, 6); 0 if unknown.
        flange, mount, start: as for `solve`.
    """
    if mount not in MOUNTS:
        raise UserError("unknown mount", key="--mount", got=mount, choices=MOUNTS)
    in_hand = mount == "flange"
    outer = flange if in_hand else inverse(flange)  # pose of the camera's mount in the frame where the board is at rest
    if start is None:
        check_motion(flange)
        methods = closed_forms(outer, board_poses)
        _refuse_mirrored(outer, board_poses, methods)
        starts = [(x, _mean(outer @ x @ board_poses)) for x in methods.values()]
    else:
        methods, starts = start.methods, [(start.camera, start.board)]
    chain = Chain(board_poses, noise, flange, in_hand)
    x, z, std = refine(chain, starts, ROUNDS if start is None else 2)
    origins = (outer @ x @ board_poses)[:, :3, 3]
    return HandEye(
        camera=x,
        board=z,
        std=std,
        robot=chain.robot,
        pixels=np.zeros(0),
        misfit=np.sqrt(np.mean(chain.standard(x, z) ** 2, axis=1)),
        scatter=float(np.sqrt(np.mean(np.sum((origins - origins.mean(axis=0)) ** 2, axis=1)))),
        scale=chain.board_scale(x, z),
        methods=methods,
    )


def closed_forms(outer: np.ndarray, board_poses: np.ndarray) -> dict[str, np.ndarray]:
    """Return X by the name of each of OpenCV's closed-form methods that finds one.

    Args:
        outer: pose of the camera's mount in the frame where the board is at rest, shape (n, 4, 4).
        board_poses: camera_T_board, shape (n, 4, 4).

    Raises:
        UserError: no method finds a solution.
    """
    import cv2

    out: dict[str, np.ndarray] = {}
    for name in METHODS:
        try:
            turn, shift = cv2.calibrateHandEye(
                list(outer[:, :3, :3]),
                list(outer[:, :3, 3]),
                list(board_poses[:, :3, :3]),
                list(board_poses[:, :3, 3]),
                method=getattr(cv2, f"CALIB_HAND_EYE_{name}"),
            )
        except cv2.error:
            continue
        if np.isfinite(turn).all() and np.isfinite(shift).all() and np.linalg.det(turn) > 0.5:
            out[name] = transform(Rotation.from_matrix(turn).as_rotvec(), np.ravel(shift))
    if not out:
        raise UserError("no method finds the camera from these poses", expected="poses turned about two axes")
    return out


def _refuse_mirrored(outer: np.ndarray, board_poses: np.ndarray, methods: dict[str, np.ndarray]) -> None:
    """Refuse views that agree with the robot's motion far better after mirroring.

    A mirrored image of a chessboard still shows a chessboard, so a single image does not reveal it. With
    S = diag(-1, 1, 1), the board poses found in mirrored images are S T S, up to a constant turn of the board. Their
    rotations still agree with the robot's motion, but their translations do not.

    Raises:
        UserError: mirroring at least halves the scatter of the board's origin, significant at 0.1 % by an F test.
    """

    def scatter(poses: np.ndarray, found: dict[str, np.ndarray]) -> float:
        at = np.stack([(outer @ x @ poses)[:, :3, 3] for x in found.values()])
        return float(np.min(np.sum((at - np.median(at, axis=1, keepdims=True)) ** 2, axis=(1, 2))))

    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    other = mirror @ board_poses @ mirror
    ratio = scatter(board_poses, methods) / max(scatter(other, closed_forms(outer, other)), 1e-18)
    freedom = 3.0 * len(outer) - 6.0  # the translations of X and Z take three each
    if ratio > 4.0 and stats.f.sf(ratio, freedom, freedom) < 1e-3:
        raise UserError(
            "the pictures are mirrored: the board moves as its mirror image would",
            expected="pictures as the camera sees, not flipped left to right",
        )


def refine(
    chain: Chain, starts: Sequence[tuple[np.ndarray, np.ndarray]], rounds: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Refine X and Z from the best start; return X, Z and the standard deviations (6,) of X.

    Weights and least squares alternate. With misfit m, a view's weight is 1 / (1 + m^2 / KNEE^2): Cauchy's loss on its
    six differences together, so that the result does not depend on the choice of axes.
    """
    from scipy.optimize import least_squares

    x, z = min(starts, key=lambda pair: float(np.median(np.linalg.norm(chain.differences(*pair), axis=1))))
    trust, covariance = np.ones(len(chain.board_poses)), np.eye(12)
    for _ in range(rounds):
        chain.weigh(x, z, trust)
        solution = least_squares(
            lambda by, x, z: chain.weighted(shifted(x, by[:6]), shifted(z, by[6:])).ravel(),
            np.zeros(12),
            jac=lambda by, x, z: chain.slopes(shifted(x, by[:6]), shifted(z, by[6:])),
            args=(x, z),
            x_scale="jac",
            max_nfev=50,
        )
        x, z = shifted(x, solution.x[:6]), shifted(z, solution.x[6:])
        trust = 1 / (1 + np.mean(chain.standard(x, z) ** 2, axis=1) / KNEE**2)
        covariance = np.linalg.pinv(solution.jac.T @ solution.jac)
    return x, z, np.sqrt(np.diag(covariance)[:6])


def _mean(poses: np.ndarray) -> np.ndarray:
    """Return the mean rotation and median translation of poses (n, 4, 4) as one pose (4, 4)."""
    out = np.eye(4)
    out[:3, :3] = Rotation.from_matrix(poses[:, :3, :3]).mean().as_matrix()
    out[:3, 3] = np.median(poses[:, :3, 3], axis=0)
    return out
