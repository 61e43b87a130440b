"""A board in the cell: its corners in each frame, and where it lies by all frames together.

Nobody knows to a tenth of a millimetre where a board was put down, so its pose is estimated from the pictures, once for
a recording. The corners' remaining misplacements are readings, as those of the borders of parts are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from vispeg.core.errors import UserError
from vispeg.recordings.cell import CellBelief
from vispeg.render.calibration.board import Board
from vispeg.render.calibration.detect import View, find
from vispeg.vision.eye import Eye
from vispeg.vision.geometry import Geometry

SOFT = 1.0  # px, misplacement from which a corner loses weight in the estimate of the pose
LEAST = 4  # corners of a view that fix a pose
KEYS = {
    "--board": "kind",
    "--pattern": "columns, rows",
}  # option of `vispeg camera calibrate` -> keys of a cell's board


@dataclass(frozen=True, eq=False)
class Look:
    """A view of the board: the camera's place (3,) m and axes (3, 3) in the base frame, and the corners found."""

    pos: np.ndarray
    turn: np.ndarray
    view: View

    def project(self, eye: Eye, points: np.ndarray) -> np.ndarray:
        """Return the pixels (n, 2) of points (n, 3) m in the base frame."""
        return eye.project((points - self.pos) @ self.turn)


@dataclass(frozen=True, eq=False)
class Corners:
    """A board's corners in one frame, (n, ...).

    Attributes:
        ids: (n,) which of the board's corners.
        place: (n, 3) m in the base frame, by all frames of the recording.
        pixel: (n, 2) px, predicted from there.
        away: (n, 2) px, measured minus predicted.
        depth: (n,) m.
    """

    ids: np.ndarray
    place: np.ndarray
    pixel: np.ndarray
    away: np.ndarray
    depth: np.ndarray


def corners_in(geometry: Geometry, camera: str, board: Board, looks: Mapping[int, Look]) -> dict[int, Corners]:
    """Return by frame the board corners that a camera sees, in the geometry's world; empty if no frame shows enough."""
    eye = geometry.eyes[camera]
    places = laid(eye, board, list(looks.values()))
    out = {}
    if places is None:
        return out
    for frame, look in looks.items():
        where = places[look.view.ids]
        pixel = look.project(eye, where)
        depth = ((where - look.pos) @ look.turn)[:, 2]
        out[frame] = Corners(look.view.ids, where, pixel, look.view.pixels - pixel, depth)
    return out


def board_of(cell: CellBelief | None, file: str | Path | None = None) -> Board | None:
    """Return the board that a cell states, None where it states none.

    Raises:
        UserError: a board that cannot be, one with a key too many or too few, or one whose corners are numbered from
            either end, as it looks the same after half a turn.
    """
    if cell is None or cell.board is None:
        return None
    try:
        board = Board(**cell.board)
    except TypeError as error:
        expected = "kind, columns, rows, square; for charuco marker and dictionary"
        raise UserError(
            "is no board", file=file, key="cell.board", expected=expected, got=", ".join(cell.board)
        ) from error
    except UserError as error:
        option = str(error.key)
        key, what = KEYS.get(option, option.lstrip("-")), str(error.args[0]).removeprefix(f"{option}: ")
        raise UserError(what, file=file, key=f"cell.board.{key}") from error
    if board.symmetric:
        expected = "one odd and one even number of inner corners, or a ChArUco board"
        raise UserError(
            "looks the same after half a turn", file=file, key="cell.board", expected=expected, got=board.pattern
        )
    return board


def view_of_board(rgb: np.ndarray, board: Board) -> View | None:
    """Return the board's corners in a picture (H, W, 3) uint8, None where it is not found."""
    import cv2

    return find(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), board)


def look_at(geometry: Geometry, camera: str, q: np.ndarray, view: View) -> Look:
    """Return a view from measured joint angles q (nj,) rad, in the geometry's world."""
    geometry.at(q)
    pos, turn = geometry.pose(camera)
    return Look(pos.copy(), turn.copy(), view)


def laid(eye: Eye, board: Board, looks: Sequence[Look]) -> np.ndarray | None:
    """Return the board's corners (n, 3) m in the base frame, at the pose that fits these views best.

    None if no view has `LEAST` corners.
    """
    enough = [look for look in looks if len(look.view.ids) >= LEAST]
    if not enough:
        return None
    start = pose_of_board(eye, board, max(enough, key=lambda look: len(look.view.ids)))

    def points(x: np.ndarray) -> np.ndarray:
        return board.points @ (Rotation.from_rotvec(x[:3]).as_matrix() @ start[:3, :3]).T + start[:3, 3] + x[3:]

    def misplaced(x: np.ndarray) -> np.ndarray:
        corners = points(x)
        parts = [look.project(eye, corners[look.view.ids]) - look.view.pixels for look in enough]
        return np.nan_to_num(np.concatenate(parts).ravel(), nan=1e3)

    return points(least_squares(misplaced, np.zeros(6), loss="cauchy", f_scale=SOFT, x_scale=[0.1] * 6).x)


def pose_of_board(eye: Eye, board: Board, look: Look) -> np.ndarray:
    """Return the board's pose (4, 4), board to base, by one view with `LEAST` corners or more."""
    import cv2

    flat = np.ascontiguousarray(eye.ideal(look.view.pixels))
    good = np.isfinite(flat).all(axis=1)
    corners = board.points[look.view.ids][good]
    _, turn, shift = cv2.solvePnP(corners, flat[good], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    out = np.eye(4)
    out[:3, :3] = look.turn @ Rotation.from_rotvec(turn.ravel()).as_matrix()
    out[:3, 3] = look.turn @ shift.ravel() + look.pos
    return out
