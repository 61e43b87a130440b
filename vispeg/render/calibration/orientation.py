"""Orientation of a board that looks the same after half a turn, from the robot's own rotation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vispeg.render.calibration.board import Board
from vispeg.render.calibration.detect import View
from vispeg.render.calibration.rigid import angles, inverse, transform


def turn_views(
    views: Sequence[View], board_poses: np.ndarray, flange: np.ndarray, board: Board
) -> tuple[list[View], np.ndarray]:
    """Renumbers the corners of views that begin at the other end than the first view.

    From AX = XB the camera turns between two views by the same angle as the flange, whatever X is. Turned boards make
    another angle, so the set of half turns is chosen that makes all pairs agree best, beginning from every view's own.

    Args:
        board_poses: camera_T_board of each view, shape (n, 4, 4).
        flange: base_T_flange of each view, shape (n, 4, 4).

    Returns:
        The views and camera_T_board with one numbering. Unchanged for a board that has a top.
    """
    if not board.two_ways:
        return list(views), board_poses
    columns, rows = board.grid
    half = transform(np.array([0, 0, np.pi]), board.square * np.array([columns - 1, rows - 1, 0.0]))
    count = len(views)
    robot = _pair_angles(flange)
    both = np.stack([board_poses, board_poses @ half])  # (2, n, 4, 4)
    best: tuple[float, np.ndarray] | None = None
    for anchor in range(count):
        turned = np.zeros(count, int)
        between = inverse(both[:, :, None]) @ both[0, anchor]  # (2, n, 1, 4, 4)
        wrong = np.abs(np.stack([angles(b[:, 0, :3, :3]) for b in between]) - robot[anchor])
        turned = wrong.argmin(axis=0)
        cost = float(np.abs(_pair_angles(both[turned, np.arange(count)]) - robot).sum())
        if best is None or cost < best[0] - 1e-12:
            best = cost, turned
    turned = best[1] if best is not None else np.zeros(count, int)
    if turned[0]:
        turned = 1 - turned  # all turned is the same board: keep the first view's own numbering
    last = columns * rows - 1
    out = [replace(view, ids=last - view.ids) if flip else view for view, flip in zip(views, turned, strict=True)]
    return out, both[turned, np.arange(count)]


def _pair_angles(poses: np.ndarray) -> np.ndarray:
    """Angle between every two poses, rad, shape (n, n)."""
    turns = poses[:, :3, :3]
    between = np.einsum("aji,bjk->abik", turns, turns)
    return angles(between.reshape(-1, 3, 3)).reshape(len(turns), len(turns))
