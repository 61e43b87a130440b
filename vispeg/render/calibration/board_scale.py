"""The effect `board_scale`: the board is larger or smaller than stated, by the evidence of the robot's motion.

A camera alone cannot distinguish a large board from a near one. A known motion of the arm, with the camera or with the
board, resolves this. If the stated size is wrong, every length found from images is wrong by the same factor, including
the camera's distance from the flange.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np

from vispeg.core.errors import UserError
from vispeg.render.calibration.board import Board
from vispeg.render.calibration.detect import View
from vispeg.render.calibration.hand_eye import HandEye, Mount, solve
from vispeg.render.calibration.intervals import half_widths, leave_out
from vispeg.render.calibration.intrinsics import Intrinsics

NAME = "board_scale"
LEAST = 0.01  # least error of the factor that is reported: errors of printers are smaller
WIDEST = (0.5, 2.0)  # errors of measuring are smaller: beyond this, poses and images do not belong together
ROUNDS = 4  # greatest number of alternations between scale and solution


class BoardEffect(TypedDict):
    """The effect as a record, in the form that diagnoses use: its value with a 95 % interval, and what it changes.

    `board_scatter_mm` and `robot_error_mm` hold two numbers, with the stated and with the identified size of the board.
    """

    effect: str
    where: str
    params: dict[str, dict[str, float]]
    square_m: float
    board_scatter_mm: list[float]
    robot_error_mm: list[float]
    moves_camera_mm: list[float]


@dataclass(frozen=True)
class BoardScale:
    """The board's size relative to the stated size.

    Attributes:
        value: factor on the stated size.
        half: half width of the factor's 95 % interval, the larger of those from the jackknife and from the fit's
            covariance.
        larger: the hand-eye solution with a board of that size.
    """

    value: float
    half: float
    larger: HandEye

    @property
    def named(self) -> bool:
        """Whether the factor differs from 1 by more than LEAST and by more than 1.5 half widths (3 standard errors)."""
        return abs(self.value - 1) > max(1.5 * self.half, LEAST)


def board_scale(
    views: Sequence[View],
    board: Board,
    camera: Intrinsics,
    flange: np.ndarray,
    mount: Mount,
    stated: HandEye,
    lens_of: Callable[[Sequence[View]], Intrinsics],
) -> BoardScale | None:
    """Return the size of the board by the robot's motion; None if it is not determined.

    Args:
        views, board, camera, flange, mount: as for `solve`.
        stated: the solution with the stated size of the board.
        lens_of: function that fits the intrinsics to the views it is given. They are fitted again without each group of
            views, because an error of the focal length changes the size of the board as well.
    """

    def shift(rows: np.ndarray) -> np.ndarray:
        kept = [views[i] for i in rows]
        factor, _ = _scaled(kept, board, lens_of(kept), flange[rows], mount, larger, value)
        return np.array([factor - value])

    try:
        value, larger = _scaled(views, board, camera, flange, mount, stated)
        left_out = float(half_widths(leave_out(len(views), shift))[0])
    except UserError:
        return None
    return BoardScale(value, max(left_out, 1.96 * value * larger.scale[1]), larger)


def _scaled(
    views: Sequence[View],
    board: Board,
    camera: Intrinsics,
    flange: np.ndarray,
    mount: Mount,
    near: HandEye,
    value: float = 1.0,
) -> tuple[float, HandEye]:
    """Return the factor on the board's size, and the solution with it, by Newton steps.

    Each solution estimates the factor that is still missing.

    Raises:
        UserError: the factor leaves the range WIDEST, or `solve` fails.
    """
    for _ in range(ROUNDS):
        near = solve(views, scaled(board, value), camera, flange, mount, start=near)
        if abs(near.scale[0] - 1) < 1e-4:
            break
        value *= near.scale[0]
        if not WIDEST[0] < value < WIDEST[1]:
            raise UserError("poses and images do not fix the size of the board")
    return value, near


def scaled(board: Board, factor: float) -> Board:
    """Return the board with its lengths multiplied by `factor`."""
    return replace(board, square=factor * board.square, marker=factor * board.marker)


def as_effect(scale: BoardScale, board: Board, stated: HandEye) -> BoardEffect:
    """Return the effect as a record."""
    value, half = scale.value, scale.half
    moved = scale.larger.camera[:3, 3] - stated.camera[:3, 3]
    return {
        "effect": NAME,
        "where": "board",
        "params": {"factor": {"value": value, "low": value - half, "high": value + half}},
        "square_m": value * board.square,
        "board_scatter_mm": [1e3 * stated.scatter, 1e3 * scale.larger.scatter],
        "robot_error_mm": [1e3 * float(stated.robot[0]), 1e3 * float(scale.larger.robot[0])],
        "moves_camera_mm": (1e3 * moved).tolist(),
    }
