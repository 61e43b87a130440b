"""Finds a board's corners in pictures, to a fraction of a pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.guard import MB, read_bytes
from vispeg.render.calibration.board import Board

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")
LARGEST = 200 * MB  # a picture file
MIN_CORNERS = 6  # of a ChArUco board seen in part: four fix a pose, two more judge it

USUAL = (
    "DICT_APRILTAG_36h11",
    "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_16h5",
    "DICT_4X4_50",
    "DICT_5X5_100",
    "DICT_6X6_250",
)
ALIKE = 1.0  # px
SEARCH = 1600  # px: the longer side of the image in which a chessboard is looked for before its corners are refined


@dataclass(frozen=True)
class View:
    """The corners found in one picture.

    Args:
        name: the picture's file name.
        size: (width, height), px.
        ids: which corners of `Board.points`, shape (n,).
        pixels: where they are, OpenCV's convention (the centre of the first pixel is (0, 0)), shape (n, 2).
    """

    name: str
    size: tuple[int, int]
    ids: np.ndarray
    pixels: np.ndarray


def pictures(folder: str | Path) -> list[Path]:
    """Give the picture files of a folder, `2.png` before `10.png`. Raises UserError where there are none."""
    root = Path(folder)
    if not root.is_dir():
        raise UserError("no such folder of images", file=folder)
    files = [p for p in root.iterdir() if p.suffix.lower() in PICTURES and not p.name.startswith(".")]
    if not files:
        raise UserError("no image here", file=folder, expected=f"files ending in {' '.join(PICTURES)}")
    return sorted(files, key=lambda p: [int(s) if s.isdigit() else s for s in _pieces(p.name)])


def read_grey(path: Path) -> np.ndarray:
    """Give a picture as grey values, uint8, shape (height, width). Raises UserError where it is not one."""
    import cv2

    try:
        how = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION  # as the sensor lies, however it was held
        image = cv2.imdecode(np.frombuffer(read_bytes(path, LARGEST), np.uint8), how)
    except cv2.error:
        image = None
    if image is None:
        raise UserError("cannot be read as an image", file=path)
    return image


def detect(images: str | Path | Sequence[Path], board: Board) -> tuple[list[View], dict[str, str]]:
    """Give the views of a folder or of some files in which the board was found; the other pictures' names with the
    reason.

    A picture that repeats another within a pixel is left out: it adds nothing, and intervals would take it for proof.

    Raises:
        UserError: no picture, pictures of different sizes, or none that shows the board.
    """
    files = pictures(images) if isinstance(images, str | Path) else list(images)
    views: list[View] = []
    missed: dict[str, str] = {}
    size: tuple[int, int] | None = None
    for path in files:
        image = read_grey(path)
        now = (image.shape[1], image.shape[0])
        if size is not None and now != size:
            raise UserError("another size than the images before it", file=path, expected=_by(size), got=_by(now))
        size = now
        view = find(image, board, path.name)
        if view is None:
            missed[path.name] = "board not found"
        elif (twin := next((v.name for v in views if _alike(view, v)), None)) is not None:
            missed[path.name] = f"repeats {twin}"
        else:
            views.append(view)
    if not views:
        many = "the image" if len(files) == 1 else f"any of {len(files)} images"
        tried = files[:1] if board.kind == "chessboard" else files  # a chessboard that is not there takes a second each
        hint = next(filter(None, (_other_pattern(read_grey(path), board) for path in tried)), "")
        what = f"{board.pattern} {board.kind}" if board.kind != "tag" else f"tag of {board.dictionary}"
        raise UserError(f"no {what} found in {many}{hint}", file=files[0].parent)
    return views, missed


def _alike(a: View, b: View) -> bool:
    """Whether the corners that both show are within `ALIKE` of each other."""
    _, in_a, in_b = np.intersect1d(a.ids, b.ids, return_indices=True)
    if len(in_a) < 4:
        return False
    return float(np.median(np.linalg.norm(a.pixels[in_a] - b.pixels[in_b], axis=1))) < ALIKE


def find(image: np.ndarray, board: Board, name: str = "image") -> View | None:
    """Give the board in one grey picture, uint8 (height, width), or None where it is not found."""
    finders = {"chessboard": _chessboard, "charuco": _charuco, "tag": _tag}
    corners = finders[board.kind](image, board)
    if corners is None:
        return None
    ids, pixels = corners
    return View(name, (image.shape[1], image.shape[0]), ids, pixels.astype(float))


def _chessboard(image: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray] | None:
    import cv2

    columns, rows = board.grid
    shrink = min(1.0, SEARCH / max(image.shape))  # no board in a large image takes a quarter of a minute otherwise
    small = image if shrink == 1 else cv2.resize(image, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    ok, corners = cv2.findChessboardCorners(small, (columns, rows), flags=flags)
    if not ok:
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
        ok, corners = cv2.findChessboardCornersSB(small, (columns, rows), flags=flags)
    if not ok:
        return None
    corners = ((corners.reshape(-1, 2) + 0.5) / shrink - 0.5).astype(np.float32)
    grid = corners.reshape(rows, columns, 2)
    # the window stays well inside a square, or a neighbour's edge pulls the corner
    side = min(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1))
    half = int(np.clip(side / 4, 2, round(5 / shrink)))
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    corners = cv2.cornerSubPix(image, corners.reshape(-1, 1, 2), (half, half), (-1, -1), stop)
    return np.arange(rows * columns), _ordered(image, corners.reshape(rows, columns, 2)).reshape(-1, 2)


def _ordered(image: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Corners (rows, columns, 2) in one order, whatever the detector's: seen from the front, dark square first."""
    along, down = grid[:, -1] - grid[:, 0], grid[-1] - grid[0]
    (ax, ay), (dx, dy) = along.mean(axis=0), down.mean(axis=0)
    if ax * dy - ay * dx < 0:
        grid = grid[::-1]
    centres = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    x, y = np.rint(centres).astype(int).reshape(-1, 2).T
    values = image[np.clip(y, 0, image.shape[0] - 1), np.clip(x, 0, image.shape[1] - 1)].reshape(centres.shape[:2])
    first = np.indices(values.shape).sum(axis=0) % 2 == 0
    return grid[::-1, ::-1] if values[first].mean() > values[~first].mean() else grid


def _charuco(image: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray] | None:
    import cv2

    corners, ids, _, _ = cv2.aruco.CharucoDetector(board.opencv()).detectBoard(image)
    if ids is None or len(ids) < MIN_CORNERS:
        return None
    ids = np.ravel(ids).astype(int)
    if np.linalg.matrix_rank(board.points[ids, :2] - board.points[ids[0], :2]) < 2:
        return None  # corners on one line fix no pose
    return ids, corners.reshape(-1, 2)


def the_tag(files: Sequence[Path], board: Board) -> Board:
    """Return the board with the number of the only tag in some pictures, where none is stated.

    Raises:
        UserError: several tags, of which one has to be named.
    """
    if board.tag is not None:
        return board
    seen = sorted({number for path in files for number in _tags(read_grey(path), board)})
    if len(seen) > 1:
        raise UserError("several tags are in sight", file=files[0].parent, key="--tag", choices=map(str, seen))
    return replace(board, tag=seen[0]) if seen else board


def _tags(image: np.ndarray, board: Board) -> dict[int, np.ndarray]:
    """Give the corners (4, 2) of each tag in a picture: top left, top right, bottom right, bottom left."""
    import cv2

    how = cv2.aruco.DetectorParameters()
    how.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    corners, ids, _ = cv2.aruco.ArucoDetector(board.words(), how).detectMarkers(image)
    return {} if ids is None else {int(n): c.reshape(4, 2) for n, c in zip(np.ravel(ids), corners, strict=True)}


def _tag(image: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray] | None:
    found = _tags(image, board)
    number = next(iter(found), None) if board.tag is None else board.tag
    return (np.arange(4), found[number][[0, 1, 3, 2]]) if number in found else None


def _other_pattern(image: np.ndarray, board: Board) -> str:
    """Give a hint where the board is there but was described in another usual way."""
    if board.kind == "tag":
        there = {name: _tags(image, replace(board, dictionary=name, tag=None)) for name in USUAL}
        found = [f"{', '.join(map(str, tags))} of {name}" for name, tags in there.items() if tags]
        return f" (there are {'; '.join(found)})" if found else ""
    if board.kind == "charuco":
        other = replace(board, legacy=not board.legacy)
        if _charuco(image, other) is not None:
            return f" (it is there {'with' if other.legacy else 'without'} --legacy)"
        mirrored = any(_charuco(np.ascontiguousarray(image[:, ::-1]), b) is not None for b in (board, other))
        return " (it is there mirrored: flip the pictures back)" if mirrored else ""
    for more in (-1, 1):
        columns, rows = board.columns + more, board.rows + more
        if min(columns, rows) >= 3 and _chessboard(image, replace(board, columns=columns, rows=rows)) is not None:
            return f" (a pattern of {columns}x{rows} inner corners is there: count corners, not squares)"
    return ""


def _pieces(name: str) -> Sequence[str]:
    import re

    return re.split(r"(\d+)", name)


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
