"""Intrinsics of a camera from views of a board: Zhang's method in OpenCV (`cv2.calibrateCameraExtended`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from vispeg.core.errors import UserError
from vispeg.render.calibration.board import Board
from vispeg.render.calibration.detect import View
from vispeg.render.calibration.rigid import move, transform

ROUNDS, ENOUGH = 200, 1e-12  # OpenCV's default of 30 iterations stops far from the optimum if the views are similar
TERMS = ("k1", "k2", "p1", "p2", "k3")
FREE = {"none": (), "radial": ("k1", "k2"), "brown4": TERMS[:4], "brown5": TERMS}
Distortion = Literal["none", "radial", "brown4", "brown5"]


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera with Brown's distortion, OpenCV's conventions.

    Args:
        size: (width, height), px.
        focal: (fx, fy), px.
        centre: (cx, cy), px; the centre of the first pixel is (0, 0).
        distortion: k1, k2, p1, p2, k3.
    """

    size: tuple[int, int]
    focal: tuple[float, float]
    centre: tuple[float, float]
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Check that the numbers are possible."""
        numbers = (*self.focal, *self.centre, *self.distortion)
        if not np.isfinite(numbers).all() or min(self.focal) <= 0 or min(self.size) < 1:
            raise UserError(
                "impossible intrinsics of a camera", expected="finite numbers, fx and fy above 0", got=numbers
            )

    @property
    def matrix(self) -> np.ndarray:
        """Camera matrix K, shape (3, 3), px."""
        return np.array([[self.focal[0], 0, self.centre[0]], [0, self.focal[1], self.centre[1]], [0, 0, 1.0]])

    @property
    def values(self) -> np.ndarray:
        """The values fx, fy, cx, cy, k1, k2, p1, p2, k3, shape (9,)."""
        return np.array([*self.focal, *self.centre, *self.distortion])

    def project(self, points: np.ndarray) -> np.ndarray:
        """Project points (n, 3) in the camera's frame, m, to pixels (n, 2)."""
        import cv2

        lens = np.array(self.distortion)
        out, _ = cv2.projectPoints(np.ascontiguousarray(points), np.zeros(3), np.zeros(3), self.matrix, lens)
        return out.reshape(-1, 2)


NAMES = ("fx", "fy", "cx", "cy", *TERMS)


@dataclass(frozen=True)
class IntrinsicsFit:
    """Fitted intrinsics.

    Attributes:
        intrinsics: the intrinsics.
        std: standard deviations due to pixel noise alone, in the order of `NAMES`, shape (9,).
        rms: RMS reprojection error, px.
    """

    intrinsics: Intrinsics
    std: np.ndarray
    rms: float


def estimate(
    views: Sequence[View], board: Board, distortion: Distortion, start: Intrinsics | None = None
) -> IntrinsicsFit:
    """Fit the intrinsics to all corners of all views.

    Args:
        views: views of one image size.
        board: the board.
        distortion: which of Brown's terms are free, as in `FREE`; the others are 0.
        start: start of the search; default: OpenCV's own guess.

    Raises:
        UserError: the views do not fix a focal length, as with fewer than three directions (Zhang 2000, section 3.1).
    """
    import cv2

    points = board.points.astype(np.float32)
    objects = [points[view.ids] for view in views]
    pixels = [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in views]
    flags, matrix, lens = _fixed(distortion), np.eye(3), np.zeros(5)
    if start is not None:
        flags |= cv2.CALIB_USE_INTRINSIC_GUESS
        matrix, lens = start.matrix, np.array(start.distortion)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, ROUNDS, ENOUGH)
    try:
        rms, matrix, lens, _, _, std, _, _ = cv2.calibrateCameraExtended(
            objects, pixels, views[0].size, matrix, lens, flags=flags, criteria=stop
        )
    except cv2.error as error:
        raise undetermined() from error
    values = np.concatenate([matrix[[0, 1, 0, 1], [0, 1, 2, 2]], np.ravel(lens)[:5]])  # in the order of NAMES
    std = np.ravel(std)[:9]
    if not np.isfinite(values).all() or not np.isfinite(std).all() or values[:2].min() <= 0:
        raise undetermined()
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = values.tolist()
    return IntrinsicsFit(Intrinsics(views[0].size, (fx, fy), (cx, cy), (k1, k2, p1, p2, k3)), std, float(rms))


def board_pose(view: View, board: Board, camera: Intrinsics) -> np.ndarray:
    """Return camera_T_board of one view, shape (4, 4), m: the pose of least squared reprojection error.

    Raises:
        UserError: no pose is found.
    """
    import cv2

    points, lens = board.points[view.ids], np.array(camera.distortion)
    ok, turn, shift = cv2.solvePnP(points, view.pixels, camera.matrix, lens, flags=cv2.SOLVEPNP_IPPE)
    if not ok or not np.isfinite(shift).all():
        raise UserError("the board's pose cannot be found from its corners", key=view.name)
    turn, shift = cv2.solvePnPRefineLM(points, view.pixels, camera.matrix, lens, turn, shift)
    return transform(np.ravel(turn), np.ravel(shift))


def view_error(view: View, board: Board, camera: Intrinsics, pose: np.ndarray) -> float:
    """Return the RMS distance, px, of a view's corners from those of a board at `pose` (camera_T_board)."""
    return rms(camera.project(move(pose, board.points[view.ids])) - view.pixels)


def rms(pixels: np.ndarray) -> float:
    """Return the root mean square length of vectors (n, 2)."""
    return float(np.sqrt(np.mean(np.sum(pixels**2, axis=1))))


def _fixed(distortion: Distortion) -> int:
    """Return OpenCV's flags that hold the terms which are not free."""
    import cv2

    if distortion not in FREE:
        raise UserError("unknown distortion", key="--distortion", got=distortion, choices=FREE)
    free, flags = FREE[distortion], 0
    for term, flag in (("k1", cv2.CALIB_FIX_K1), ("k2", cv2.CALIB_FIX_K2), ("k3", cv2.CALIB_FIX_K3)):
        flags |= 0 if term in free else flag
    return flags if "p1" in free else flags | cv2.CALIB_ZERO_TANGENT_DIST


def undetermined(got: str | None = None) -> UserError:
    """Return the error for views that are too similar to fix the focal length."""
    message = "the images do not fix the focal length: take some with the board tilted 20 to 45 degrees, both ways"
    return UserError(message, got=got)
