"""Find a board's corners in images, to a fraction of a pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.guard import MB, read_bytes
from vispeg.render.calibration.board import Board

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")
LARGEST = 200 * MB  # greatest size of an image file
MIN_CORNERS = 6  # of a partly visible ChArUco board: four fix a pose, two more check it
USUAL = (  # dictionaries that are tried if the stated one shows no tag, for a hint
    "DICT_APRILTAG_36h11",
    "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_16h5",
    "DICT_4X4_50",
    "DICT_5X5_100",
    "DICT_6X6_250",
)
ALIKE = 1.0  # px, median distance of corners below which two images count as the same view
SEARCH = 1600  # px: images are shrunk to this longer side to find a chessboard; its corners are refined in full size


@dataclass(frozen=True)
class View:
    """The corners found in one image.

    Args:
        name: the image's file name.
        size: (width, height), px.
        ids: indices of the corners in `Board.points`, shape (n,).
        pixels: positions of the corners, shape (n, 2), px; the centre of the first pixel is (0, 0).
    """

    name: str
    size: tuple[int, int]
    ids: np.ndarray
    pixels: np.ndarray


def pictures(folder: str | Path) -> list[Path]:
    """Return the image files of a folder, `2.png` before `10.png`. Raises UserError if there is none."""
    root = Path(folder)
    if not root.is_dir():
        raise UserError(
            "is no folder" if root.exists() else "does not exist", file=folder, expected="a folder of images"
        )
    files = [p for p in root.iterdir() if p.suffix.lower() in PICTURES and not p.name.startswith(".")]
    if not files:
        raise UserError("no image here", file=folder, expected=f"files ending in {' '.join(PICTURES)}")
    return sorted(files, key=lambda p: [int(s) if s.isdigit() else s for s in _pieces(p.name)])


def read_grey(path: Path) -> np.ndarray:
    """Return an image file's grey values, uint8, shape (height, width). Raises UserError if it cannot be read."""
    import cv2

    try:
        # keep the sensor's own axes, whatever orientation the file states
        how = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
        image = cv2.imdecode(np.frombuffer(read_bytes(path, LARGEST), np.uint8), how)
    except cv2.error:
        image = None
    if image is None:
        raise UserError("cannot be read as an image", file=path)
    return image


def detect(images: str | Path | Sequence[Path], board: Board) -> tuple[list[View], dict[str, str]]:
    """Find the board in images; return the views, and the names of the other images with the reason.

    An image that repeats another within a pixel is left out: it adds no information and would make intervals too
    narrow.

    Args:
        images: a folder, or image files.
        board: the board.

    Raises:
        UserError: there is no image, sizes differ, or no image shows the board.
    """
    files = pictures(images) if isinstance(images, str | Path) else list(images)
    views: list[View] = []
    missed: dict[str, str] = {}
    size: tuple[int, int] | None = None
    for path in files:
        image = read_grey(path)
        this_size = (image.shape[1], image.shape[0])
        if size is not None and this_size != size:
            raise UserError("another size than the images before it", file=path, expected=_by(size), got=_by(this_size))
        size = this_size
        view = find(image, board, path.name)
        if view is None:
            missed[path.name] = "board not found"
        elif (twin := next((v.name for v in views if _alike(view, v)), None)) is not None:
            missed[path.name] = f"repeats {twin}"
        else:
            views.append(view)
    if not views:
        where = "the image" if len(files) == 1 else f"any of {len(files)} images"
        # the search for a missing chessboard takes a second per image
        tried = files[:1] if board.kind == "chessboard" else files
        hint = next(filter(None, (_other_pattern(read_grey(path), board) for path in tried)), "")
        what = f"{board.pattern} {board.kind}" if board.kind != "tag" else f"tag of {board.dictionary}"
        raise UserError(f"no {what} found in {where}{hint}", file=files[0].parent)
    return views, missed


def _alike(a: View, b: View) -> bool:
    """Return whether the corners that two views share, four or more, differ by less than `ALIKE` in the median."""
    _, in_a, in_b = np.intersect1d(a.ids, b.ids, return_indices=True)
    if len(in_a) < 4:
        return False
    return float(np.median(np.linalg.norm(a.pixels[in_a] - b.pixels[in_b], axis=1))) < ALIKE


def find(image: np.ndarray, board: Board, name: str = "image") -> View | None:
    """Return the view of the board in one grey image, uint8 (height, width); None if it is not found."""
    finders = {"chessboard": _chessboard, "charuco": _charuco, "tag": _tag}
    corners = finders[board.kind](image, board)
    if corners is None:
        return None
    ids, pixels = corners
    return View(name, (image.shape[1], image.shape[0]), ids, pixels.astype(float))


def _chessboard(image: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray] | None:
    import cv2

    columns, rows = board.grid
    shrink = min(1.0, SEARCH / max(image.shape))  # a large image without a board would take 15 s otherwise
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
    # keep the window well inside a square, or edges of a neighbour bias the corner
    side = min(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1))
    half = int(np.clip(side / 4, 2, round(5 / shrink)))
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    corners = cv2.cornerSubPix(image, corners.reshape(-1, 1, 2), (half, half), (-1, -1), stop)
    return np.arange(rows * columns), _ordered(image, corners.reshape(rows, columns, 2)).reshape(-1, 2)


def _ordered(image: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Return corners (rows, columns, 2) in one definite order, whatever the detector's.

    Rows and columns run as on a board seen from the front, and the first square is the dark one where colours differ
    between the two ends.
    """
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
        return None  # corners on one line do not fix a pose
    return ids, corners.reshape(-1, 2)


def the_tag(files: Sequence[Path], board: Board) -> Board:
    """Return the board, with the number of the only tag in the images if it states none.

    Raises:
        UserError: the images show several tags, and the board does not say which one.
    """
    if board.tag is not None:
        return board
    seen = sorted({number for path in files for number in _tags(read_grey(path), board)})
    if len(seen) > 1:
        raise UserError("several tags are in sight", file=files[0].parent, key="--tag", choices=map(str, seen))
    return replace(board, tag=seen[0]) if seen else board


def _tags(image: np.ndarray, board: Board) -> dict[int, np.ndarray]:
    """Return by number the corners (4, 2), px, of each tag: top left, top right, bottom right, bottom left."""
    import cv2

    how = cv2.aruco.DetectorParameters()
    how.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    corners, ids, _ = cv2.aruco.ArucoDetector(board.markers(), how).detectMarkers(image)
    return {} if ids is None else {int(n): c.reshape(4, 2) for n, c in zip(np.ravel(ids), corners, strict=True)}


def _tag(image: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray] | None:
    found = _tags(image, board)
    number = next(iter(found), None) if board.tag is None else board.tag
    return (np.arange(4), found[number][[0, 1, 3, 2]]) if number in found else None  # row after row


def _other_pattern(image: np.ndarray, board: Board) -> str:
    """Return a hint if the image shows a board that fits another common description; else an empty string."""
    if board.kind == "tag":
        seen = {name: _tags(image, replace(board, dictionary=name, tag=None)) for name in USUAL}
        found = [f"{', '.join(map(str, tags))} of {name}" for name, tags in seen.items() if tags]
        return f" (there are {'; '.join(found)})" if found else ""
    if board.kind == "charuco":
        other = replace(board, legacy=not board.legacy)
        if _charuco(image, other) is not None:
            return f" (it is there {'with' if other.legacy else 'without'} --legacy)"
        mirrored = any(_charuco(np.ascontiguousarray(image[:, ::-1]), b) is not None for b in (board, other))
        return " (it is there mirrored: flip the pictures back)" if mirrored else ""
    for extra in (-1, 1):
        columns, rows = board.columns + extra, board.rows + extra
        if min(columns, rows) >= 3 and _chessboard(image, replace(board, columns=columns, rows=rows)) is not None:
            return f" (a pattern of {columns}x{rows} inner corners is there: count corners, not squares)"
    return ""


def _pieces(name: str) -> Sequence[str]:
    """Split a name into text and numbers."""
    import re

    return re.split(r"(\d+)", name)


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
