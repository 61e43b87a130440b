"""Draw the corners of a calibration image: as detected, and as the calibration predicts them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vispeg.render.calibration.board import Board
from vispeg.render.calibration.calibrate import Calibration
from vispeg.render.calibration.detect import read_grey
from vispeg.render.calibration.intrinsics import board_pose
from vispeg.render.calibration.rigid import inverse, move

SCALE = 2  # factor of enlargement, so that half a pixel is visible
DETECTED, FITTED, ROBOT = (80, 220, 80), (255, 140, 40), (60, 60, 255)  # BGR: green, blue, red


def overlay(path: Path, calibration: Calibration, board: Board, number: int, flange: np.ndarray | None) -> bytes:
    """Return a PNG of one view with its corners.

    Green rings are the corners as detected. Blue crosses are reprojected from the board's pose that fits this view
    best, red crosses from the pose that the robot reports.

    Args:
        path: the image.
        calibration: the calibration.
        board: the board.
        number: index of the view in `calibration.views`.
        flange: base_T_flange of this view, shape (4, 4); None without poses.
    """
    import cv2

    view, points = calibration.views[number], board.points[calibration.views[number].ids]
    image = cv2.cvtColor(cv2.resize(read_grey(path), None, fx=SCALE, fy=SCALE), cv2.COLOR_GRAY2BGR)
    for at in _pixels(view.pixels):
        cv2.circle(image, at, 5, DETECTED, 1, cv2.LINE_AA)
    fitted = calibration.camera.project(move(board_pose(view, board, calibration.camera), points))
    for at in _pixels(fitted):
        cv2.drawMarker(image, at, FITTED, cv2.MARKER_CROSS, 7, 1, cv2.LINE_AA)
    words = [("detected", DETECTED), (f"reprojected {calibration.fit_pixels[number]:.2f} px", FITTED)]
    if calibration.hand_eye is not None and flange is not None:
        outer = flange if calibration.mount == "flange" else inverse(flange)
        pose = inverse(calibration.hand_eye.camera) @ inverse(outer) @ calibration.hand_eye.board
        for at in _pixels(calibration.camera.project(move(pose, points))):
            cv2.drawMarker(image, at, ROBOT, cv2.MARKER_TILTED_CROSS, 7, 1, cv2.LINE_AA)
        words.append((f"through the robot {calibration.hand_eye.pixels[number]:.2f} px", ROBOT))
    x = 10
    for word, colour in words:
        for ink, width in (((0, 0, 0), 4), (colour, 1)):
            cv2.putText(image, word, (x, image.shape[0] - 12), cv2.FONT_HERSHEY_SIMPLEX, 0.6, ink, width, cv2.LINE_AA)
        x += 16 + cv2.getTextSize(word, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 1)[0][0]
    return cv2.imencode(".png", image)[1].tobytes()


def _pixels(at: np.ndarray) -> list[tuple[int, int]]:
    """Convert pixels (n, 2) of the original to whole pixels of the enlarged image, centres at integers in both."""
    large = np.clip(np.nan_to_num((at + 0.5) * SCALE - 0.5), -1e4, 1e4)
    return [(int(x), int(y)) for x, y in np.rint(large)]
