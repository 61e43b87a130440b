"""Read the sights of a recording with frames: one for each camera with a stated pose."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from vispeg.core.errors import UserError
from vispeg.core.rules import RULES
from vispeg.identify.pictures.coarse import DELAYS
from vispeg.identify.pictures.points import INSTANT
from vispeg.identify.pictures.sight import Sight
from vispeg.recordings.frames.frames import Frames
from vispeg.recordings.frames.joints import GAP, joints_at
from vispeg.recordings.recording import Recording
from vispeg.render.calibration.detect import View
from vispeg.vision.board import board_of, view_of_board
from vispeg.vision.eye import camera_of

MOST = 40  # largest number of frames per camera and recording; of more, evenly spaced ones


def sights_of(recordings: Sequence[Recording]) -> list[Sight]:
    """Return the frames of recordings, one sight per recording and camera.

    Raises:
        UserError: a recording without frames, a camera whose pose is not stated, or too few frames to compare.
    """
    out = []
    for rec in recordings:
        if rec.frames is None or not len(rec.frames):
            raise UserError(
                "has no pictures", file=rec.path, expected="frames/index.csv, as other recordings here have"
            )
        for name in rec.frames.names:
            out.append(_sight(rec, name, rec.frames.of(name)))
    return out


def comparable(rec: Recording) -> bool:
    """Return whether `sights_of` accepts a recording: every camera has a stated pose and enough frames."""
    frames = rec.frames
    if frames is None or not len(frames) or any(frames.cameras[name].pose is None for name in frames.names):
        return False
    return all(len(_with_angles(rec, frames.of(name))) >= RULES.frames_least for name in frames.names)


def _with_angles(rec: Recording, frames: Frames) -> np.ndarray:
    """Return the indices (n,) of the frames whose joint angles are known, whatever the delay of the camera."""
    # the bounds of the delay, and `INSTANT` farther for the finite difference of a pixel's speed
    asked = (0.0, -DELAYS.max() - INSTANT, -DELAYS.min() + INSTANT)
    known = [np.isfinite(joints_at(rec, frames.times + t, frames.episodes)).all(1) for t in asked]
    return np.flatnonzero(np.all(known, axis=0))


def _curve(rec: Recording, episode: int) -> CubicSpline | None:
    """Return the spline of an episode, the same as in `joints_at`; None if it has gaps or missing readings."""
    rows = slice(None) if rec.episode is None else rec.episode == episode
    time, q = rec.time[rows], rec.q[rows]
    unbroken = np.isfinite(q).all() and len(time) >= 4 and np.diff(time).max() <= GAP / rec.rate_hz
    return CubicSpline(time, q, extrapolate=False) if unbroken else None


def _sight(rec: Recording, name: str, frames: Frames) -> Sight:
    """Return the sight of camera `name`, of which `frames` are all frames; raise UserError if too few are usable."""
    episodes = frames.episodes
    q, rows = joints_at(rec, frames.times, episodes), _with_angles(rec, frames)
    if len(rows) < RULES.frames_least:
        what = f"camera '{name}' has too few frames at measured joint angles"
        raise UserError(what, file=rec.path, expected=f"{RULES.frames_least} or more", got=len(rows))
    if len(rows) > MOST:
        rows = rows[np.linspace(0, len(rows) - 1, MOST).round().astype(int)]
    used, times, numbers = [frames[int(i)] for i in rows], frames.times[rows], episodes[rows]
    # one spline saves time where all frames are of one unbroken episode
    curve = _curve(rec, numbers[0]) if (numbers == numbers[0]).all() else None

    def joints(time: np.ndarray, which: np.ndarray) -> np.ndarray:
        return joints_at(rec, time, numbers[which]) if curve is None else curve(time)

    board = board_of(rec.cell, rec.path / "recording.yaml")

    @cache
    def corners(i: int) -> View | None:
        rgb = None if board is None else used[i].rgb
        return None if rgb is None or board is None else view_of_board(rgb, board)

    def again(i: int) -> np.ndarray | None:
        """Return the depth (H, W) m of another frame of the same standstill; None if there is none."""
        other = _held(q, episodes, int(rows[i]))
        return None if other is None else frames[other].depth

    recorded = frames.cameras[name]
    pictures = (lambda i: used[i].rgb), (lambda i: used[i].depth)
    return Sight(rec.name, camera_of(recorded), times, joints, *pictures, board, corners, again, recorded.sensor, rec)


def _held(q: np.ndarray, episodes: np.ndarray, row: int) -> int | None:
    """Return the index of another frame of the same standstill as `row`; None if there is none.

    It is the last frame of the standstill, or the first if `row` is the last.

    Args:
        q: (n, nj) rad, joint angles at each frame; NaN if unknown.
        episodes: (n,) of each frame.
        row: index of the frame.
    """
    still = (np.abs(q - q[row]).max(axis=1) < RULES.frame_still) & (episodes == episodes[row])
    moved = np.flatnonzero(~still)
    last = int(moved[moved > row].min(initial=len(q))) - 1
    first = int(moved[moved < row].max(initial=-1)) + 1
    return last if last > row else first if first < row else None
