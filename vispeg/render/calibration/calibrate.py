"""Calibrate a camera from views: its intrinsics and its pose, with intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.rotation import quaternion
from vispeg.render.calibration.board import Board
from vispeg.render.calibration.board_scale import BoardScale, board_scale
from vispeg.render.calibration.detect import View
from vispeg.render.calibration.hand_eye import HandEye, Mount, check_motion, solve
from vispeg.render.calibration.intervals import half_widths, leave_out
from vispeg.render.calibration.intrinsics import (
    NAMES,
    Distortion,
    Intrinsics,
    IntrinsicsFit,
    board_pose,
    estimate,
    undetermined,
    view_error,
)
from vispeg.render.calibration.rigid import angles, difference, inverse, transform
from vispeg.render.cameras.camera import Camera

MIN_VIEWS = 4  # three determine the result, and leaving one out must leave three
LOOSE = 0.06  # half width of the focal length, relative to it, above which the views do not determine it
SUSPICIOUS = 5.0  # px, reprojection error through the robot above which the other mount is tried


@dataclass(frozen=True)
class Calibration:
    """The result of a calibration.

    Args:
        camera: the intrinsics, fitted or given.
        intrinsics: the fit of the intrinsics; None if they were given.
        intrinsics_half: half widths of the 95 % intervals of fx, fy, cx, cy, k1, k2, p1, p2, k3, shape (9,): the larger
            of those from pixel noise and from the jackknife; 0 for a term held at 0; None if intrinsics were given.
        mount: what the camera is fixed to, `flange` or `base`; None without poses.
        hand_eye: the pose of the camera; None without poses.
        hand_eye_half: half widths of the 95 % intervals of the camera's pose, shape (6,): m along the mount's axes, rad
            about the camera's. Given intrinsics count as exact.
        views: the views used, with one numbering of corners.
        fit_pixels: RMS reprojection error of each view with its own best board pose, px, shape (n,).
        board_scale: the size of the board by the robot's motion; None without poses, or if they do not fix it.
    """

    camera: Intrinsics
    intrinsics: IntrinsicsFit | None
    intrinsics_half: np.ndarray | None
    mount: Mount | None
    hand_eye: HandEye | None
    hand_eye_half: np.ndarray | None
    views: tuple[View, ...]
    fit_pixels: np.ndarray
    board_scale: BoardScale | None = None

    def to_camera(self, name: str) -> Camera:
        """Return a Camera of this name, with its pose on the mount, or at the base's origin without poses.

        Raises:
            UserError: the lens distortion is not one to one inside the image. This happens if more distortion terms are
                fitted than the views determine.
        """
        lens, (width, height) = self.camera, self.camera.size
        camera = Camera(name, width, height, *lens.focal, *lens.centre, lens.distortion)
        if self.hand_eye is None or self.mount is None:
            return camera
        place = self.hand_eye.camera
        return camera.moved(parent=self.mount, pos=tuple(place[:3, 3]), quat=tuple(quaternion(place[:3, :3]).tolist()))


def calibrate(
    views: Sequence[View],
    board: Board,
    *,
    distortion: Distortion = "brown4",
    camera: Intrinsics | None = None,
    flange: np.ndarray | None = None,
    mount: Mount = "flange",
) -> Calibration:
    """Calibrate a camera.

    Args:
        views: the views of the board, one per image.
        board: the board.
        distortion: which terms of the lens distortion to fit; ignored if `camera` is given.
        camera: known intrinsics; None to fit them to the views.
        flange: base_T_flange of each view, shape (n, 4, 4), m; None for intrinsics alone.
        mount: `flange` for eye in hand, `base` for eye to base with the board on the flange.

    Raises:
        UserError: images or motion do not determine the result, or sizes or poses do not fit the views.
    """
    if len(views) < MIN_VIEWS:
        raise UserError(
            "too few images show the board", expected=f"{MIN_VIEWS} or more, from different directions", got=len(views)
        )
    if camera is not None and camera.size != views[0].size:
        raise UserError("intrinsics of another image size", expected=views[0].size, got=camera.size)
    if flange is not None:
        if len(flange) != len(views):
            raise UserError("poses and views do not pair", expected=len(views), got=len(flange))
        check_motion(flange)
    fit: IntrinsicsFit | None = None
    if camera is None:
        fit = estimate(views, board, distortion)
        camera = fit.intrinsics
    board_poses = np.stack([board_pose(view, board, camera) for view in views])
    hand_eye: HandEye | None = None
    if flange is not None:
        views, board_poses = turn_views(views, board_poses, flange, board)
        hand_eye = solve(views, board, camera, flange, mount)
        _refuse_other_mount(hand_eye, views, board, camera, flange, mount)

    def lens_of(kept: Sequence[View]) -> Intrinsics:
        return camera if fit is None else estimate(kept, board, distortion, start=camera).intrinsics

    lens_half, pose_half = _half_widths(views, board, camera, lens_of, fit, flange, mount, hand_eye)
    if lens_half is not None and (lens_half[:2] / camera.focal).max() > LOOSE:
        raise undetermined(f"fx {camera.focal[0]:.4g} +- {lens_half[0]:.2g} px")
    scale = None
    if hand_eye is not None and flange is not None:
        scale = board_scale(views, board, camera, flange, mount, hand_eye, lens_of)
    return Calibration(
        camera,
        fit,
        lens_half,
        mount if hand_eye is not None else None,
        hand_eye,
        pose_half,
        tuple(views),
        np.array([view_error(view, board, camera, pose) for view, pose in zip(views, board_poses, strict=True)]),
        scale,
    )


def _half_widths(
    views: Sequence[View],
    board: Board,
    camera: Intrinsics,
    lens_of: Callable[[Sequence[View]], Intrinsics],
    fit: IntrinsicsFit | None,
    flange: np.ndarray | None,
    mount: Mount,
    hand_eye: HandEye | None,
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return half widths of the intrinsics (9,) and of the camera's pose (6,); None for either if not estimated."""

    def shift(retained: np.ndarray) -> np.ndarray:
        kept, out = [views[i] for i in retained], []
        try:
            lens = lens_of(kept)
            if fit is not None:
                out.append(lens.values - camera.values)
            if hand_eye is not None and flange is not None:
                near = solve(kept, board, lens, flange[retained], mount, start=hand_eye)
                out.append(difference(near.camera, hand_eye.camera))
        except UserError as error:
            without = ", ".join(view.name for i, view in enumerate(views) if i not in retained)
            raise UserError(f"the result depends on {without}; take more images: without it, {error}") from error
        return np.concatenate(out)

    if fit is None and hand_eye is None:
        return None, None
    half = half_widths(leave_out(len(views), shift))
    lens_half = None if fit is None else np.maximum(half[: len(NAMES)], 1.96 * fit.std)
    pose_half = None if hand_eye is None else np.maximum(half[-6:], 1.96 * hand_eye.std)
    return lens_half, pose_half


def _refuse_other_mount(
    hand_eye: HandEye, views: Sequence[View], board: Board, camera: Intrinsics, flange: np.ndarray, mount: Mount
) -> None:
    """Refuse poses that fit far better if the camera is on the other mount, or if the poses are inverted.

    Both mistakes give the same equations: inverted poses with a camera on the flange look like a camera on the base.
    One trial with the other mount therefore detects both.
    """
    error = float(np.median(hand_eye.pixels))
    if error < SUSPICIOUS:
        return
    try:
        other = float(np.median(solve(views, board, camera, flange, "base" if mount == "flange" else "flange").pixels))
    except UserError:
        return
    if other < error / 5:
        raise UserError(
            "the poses fit the other way round: --mount is wrong, or they are the base's in the flange's frame",
            expected="base_T_flange",
            got=f"{error:.3g} px off, {other:.3g} px the other way",
        )


def turn_views(
    views: Sequence[View], board_poses: np.ndarray, flange: np.ndarray, board: Board
) -> tuple[list[View], np.ndarray]:
    """Renumber the corners of views whose numbering begins at the other end of the board than in the first view.

    By AX = XB, the camera turns between two views by the same angle as the flange, whatever X is. With a board numbered
    from the other end the angles differ. So half turns of the board are chosen, view by view, that make the angles of
    all pairs agree best. The search starts from each view in turn, which keeps its numbering.

    Args:
        views: the views.
        board_poses: camera_T_board of each view, shape (n, 4, 4).
        flange: base_T_flange of each view, shape (n, 4, 4).

    Returns:
        The views and camera_T_board with one numbering; unchanged for a board that differs from its half turn.
    """
    if not board.symmetric:
        return list(views), board_poses
    columns, rows = board.grid
    half = transform(np.array([0, 0, np.pi]), board.square * np.array([columns - 1, rows - 1, 0.0]))
    count = len(views)
    robot = _pair_angles(flange)
    both = np.stack([board_poses, board_poses @ half])  # (2, n, 4, 4)
    best: tuple[float, np.ndarray] | None = None
    for anchor in range(count):
        between = inverse(both[:, :, None]) @ both[0, anchor]  # (2, n, 1, 4, 4)
        wrong = np.abs(np.stack([angles(b[:, 0, :3, :3]) for b in between]) - robot[anchor])
        turned = wrong.argmin(axis=0)
        cost = float(np.abs(_pair_angles(both[turned, np.arange(count)]) - robot).sum())
        if best is None or cost < best[0] - 1e-12:
            best = cost, turned
    turned = best[1] if best is not None else np.zeros(count, int)
    if turned[0]:
        turned = 1 - turned  # turning all boards changes nothing: keep the first view's numbering
    last = columns * rows - 1
    out = [replace(view, ids=last - view.ids) if flip else view for view, flip in zip(views, turned, strict=True)]
    return out, both[turned, np.arange(count)]


def _pair_angles(poses: np.ndarray) -> np.ndarray:
    """Return the angle of rotation, rad, between every two poses (n, 4, 4), shape (n, n)."""
    turns = poses[:, :3, :3]
    between = np.einsum("aji,bjk->abik", turns, turns)
    return angles(between.reshape(-1, 3, 3)).reshape(len(turns), len(turns))
