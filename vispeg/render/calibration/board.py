"""The flat board that a camera is calibrated with: a chessboard, a ChArUco board, or one tag (AprilTag, ArUco)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from vispeg.core.errors import UserError

KINDS = ("chessboard", "charuco", "tag")


@dataclass(frozen=True)
class Board:
    """The pattern and size of a calibration board.

    The board's frame has its origin at the first corner, x along a row, y along a column and z into the board.

    Args:
        kind: `chessboard`, `charuco` (a chessboard with an ArUco marker in every light square), or `tag`.
        columns, rows: numbers in a row and in a column, counted as OpenCV does: *inner corners* of a chessboard,
            *squares* of a ChArUco board. 1 and 1 for a tag.
        square: side of a square, or of a tag's black frame, m.
        marker: side of a marker, m; ChArUco only.
        dictionary: OpenCV's name of the markers' dictionary, such as `DICT_4X4_50`; empty for a chessboard.
        legacy: whether a ChArUco board follows OpenCV before 4.6, where boards with an even number of rows begin with a
            marker.
        tag: number of the tag; None for any tag.

    Raises:
        UserError: a size or count is impossible, or OpenCV does not have the dictionary.
    """

    kind: Literal["chessboard", "charuco", "tag"]
    columns: int
    rows: int
    square: float
    marker: float = 0.0
    dictionary: str = ""
    legacy: bool = False
    tag: int | None = None

    def __post_init__(self) -> None:
        """Check the sizes and counts."""
        if self.kind not in KINDS:
            raise UserError("unknown board", key="--board", got=self.kind, choices=KINDS)
        if self.kind == "tag":
            self._check_tag()
        elif min(self.columns, self.rows) < 3 or max(self.columns, self.rows) > 100:
            raise UserError("no such pattern", key="--pattern", expected="3x3 to 100x100", got=self.pattern)
        if not 1e-4 <= self.square <= 1.0:
            raise UserError("impossible size of a square", key="--square", expected="0.0001 to 1 m", got=self.square)
        if self.kind == "chessboard" and self.columns == self.rows:
            raise UserError(
                "a chessboard with as many columns as rows has no definite orientation",
                key="--pattern",
                expected="different numbers of columns and rows, best one odd and one even, or a ChArUco board",
                got=self.pattern,
            )
        if self.kind == "charuco":
            if not 0.0 < self.marker < self.square:
                raise UserError(
                    "impossible size of a marker", key="--marker", expected=f"0 to {self.square} m", got=self.marker
                )
            self.opencv()

    def _check_tag(self) -> None:
        if (self.columns, self.rows) != (1, 1):
            raise UserError("a tag has no pattern", key="--pattern", expected="1x1", got=self.pattern)
        markers = self.markers()
        if self.tag is not None and not 0 <= self.tag < len(markers.bytesList):
            expected = f"0 to {len(markers.bytesList) - 1} of {self.dictionary}"
            raise UserError("no such tag", key="--tag", expected=expected, got=self.tag)

    @property
    def pattern(self) -> str:
        """Columns and rows as text, such as `9x6`."""
        return f"{self.columns}x{self.rows}"

    @property
    def symmetric(self) -> bool:
        """Whether the board looks the same after half a turn about its centre, colours included."""
        return self.kind == "chessboard" and (self.columns + self.rows) % 2 == 0

    @property
    def grid(self) -> tuple[int, int]:
        """Numbers of corners in a row and in a column: inner ones, or the outer ones of a tag."""
        extra = {"charuco": -1, "chessboard": 0, "tag": 1}[self.kind]
        return self.columns + extra, self.rows + extra

    @property
    def points(self) -> np.ndarray:
        """Corners (n, 3) in the board's frame, row after row, m: the inner ones, or the four outer ones of a tag."""
        columns, rows = self.grid
        y, x = np.mgrid[:rows, :columns]
        return self.square * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)

    def markers(self) -> Any:
        """Return OpenCV's dictionary of markers. Raises UserError for an unknown one."""
        import cv2

        names = sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))
        if self.dictionary not in names:
            raise UserError("unknown dictionary", key="--dictionary", got=self.dictionary, choices=names)
        return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))

    def opencv(self) -> Any:
        """Return the `cv2.aruco.CharucoBoard`. Raises UserError for a dictionary that is unknown or too small."""
        import cv2

        markers = self.markers()
        if len(markers.bytesList) < self.columns * self.rows // 2:
            raise UserError(
                "the dictionary has fewer markers than the board",
                key="--dictionary",
                expected=f"{self.columns * self.rows // 2}",
                got=f"{self.dictionary}: {len(markers.bytesList)}",
            )
        board = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square, self.marker, markers)
        board.setLegacyPattern(self.legacy)
        return board


def parse_pattern(text: str) -> tuple[int, int]:
    """Return the columns and rows in a text such as `9x6`. Raises UserError for any other text."""
    match = re.fullmatch(r"(\d{1,3})\s*[xX]\s*(\d{1,3})", text.strip())
    if match is None:
        what = "not a pattern" if text else "is required of a board, not of a tag"
        raise UserError(what, key="--pattern", expected="COLUMNSxROWS, as in 9x6", got=text or None)
    return int(match[1]), int(match[2])
