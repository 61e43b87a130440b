"""The effect `board_scale`: the board is larger or smaller than it is said to be, as the robot's motion shows.

A camera cannot tell a large board from a near one; an arm that moves it, or moves about it, by a known length can.
Every length that images give is then off by one factor, the camera's distance from the flange among them.
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

NAME, LEAST = "board_scale", 0.01  # a printer's own error is below a hundredth
WIDEST = (0.5, 2.0)  # a ruler's slip is no more: beyond it poses and images do not belong together
ROUNDS = 4  # of scale and solution in turn


class BoardEffect(TypedDict):
    """An effect of a calibration, in the words of a diagnosis: value and 95 % interval, and what it takes away."""

    effect: str
    where: str
    params: dict[str, dict[str, float]]
    square_m: float
    board_scatter_mm: list[float]
    robot_error_mm: list[float]
    moves_camera_mm: list[float]


@dataclass(frozen=True)
class BoardScale:
    """How large the board is, relative to what was said.

    Attributes:
        value, half: factor on the board's size, and half the width of its 95 % interval: the larger of what leaving
            out views says and of what the fit's own covariance says.
        larger: the solution with a board of that size.
    """

    value: float
    half: float
    larger: HandEye

    @property
    def named(self) -> bool:
        """Whether it is off 1 by 1.5 half widths (three standard errors), and by more than a printer errs."""
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
    """Give the size of the board by the robot's motion; None where they do not tell, or not with a view less.

    Args:
        views, board, camera, flange, mount: as `solve` takes them.
        stated: the solution with the board as it is said to be.
        lens_of: the intrinsics by some of the views: a camera that takes all for farther makes the board larger.
    """

    def shift(rows: np.ndarray) -> np.ndarray:
        some = [views[i] for i in rows]
        there = _scaled(some, board, lens_of(some), flange[rows], mount, larger, value)
        return np.array([there[0] - value])

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
    """Newton's steps: each solution says by which factor more the board should be larger."""
    for _ in range(ROUNDS):
        near = solve(views, scaled(board, value), camera, flange, mount, start=near)
        if abs(near.scale[0] - 1) < 1e-4:
            break
        value *= near.scale[0]
        if not WIDEST[0] < value < WIDEST[1]:
            raise UserError("poses and images do not say how large the board is")
    return value, near


def scaled(board: Board, factor: float) -> Board:
    """Give the board, `factor` times as large."""
    return replace(board, square=factor * board.square, marker=factor * board.marker)


def as_effect(scale: BoardScale, board: Board, stated: HandEye) -> BoardEffect:
    """For a record: before and after where something changes."""
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
