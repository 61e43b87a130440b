"""Unwrap angles that are reported modulo one turn, and shift them by whole turns into the joint's range."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.recording import Recording
from vispeg.recordings.validate import MAX_ANGLE

TURN = 2 * np.pi
NEAR = np.pi / 2  # rad, largest deviation of a step from a whole turn that counts as a wrap
WITHIN = 0.02  # share of the shifted angles that may lie outside the range; with a wrong unit more do
SLACK = 0.1  # rad beyond a stated range, as the ranges in robot files are not exact


def straightened(
    q: np.ndarray, limits: np.ndarray | None = None, episode: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Unwrap angles, and shift each joint by whole turns so that most of its angles lie in its range.

    Args:
        q: (n, nj) rad, NaN where missing.
        limits: (nj, 2) rad, infinite where not known, where angles are unwrapped but not shifted; None for all joints.
        episode: (n,) episode number of each row; None for a single episode.

    Returns:
        The angles (n, nj) rad, and whether each joint was changed, (nj,) bool.
    """
    if limits is None:
        limits = np.tile([-np.inf, np.inf], (q.shape[1], 1))
    out = np.array(q, float)
    breaks = [] if episode is None else np.flatnonzero(np.diff(episode) != 0) + 1
    for rows in np.split(np.arange(len(q)), breaks):
        for j in range(q.shape[1]):
            good = rows[np.isfinite(q[rows, j])]
            if len(good) and np.ptp(q[good, j]) <= TURN + SLACK:  # angles that span more than a turn do not wrap
                out[good, j] = _into(_unwrapped(q[good, j]), *limits[j])
    return out, np.any((out != q) & np.isfinite(q), axis=0)


def beside(goal: np.ndarray, q: np.ndarray, episode: np.ndarray | None = None) -> np.ndarray:
    """Unwrap commanded angles (n, nj) rad, and shift each by the whole turns per episode that bring it nearest to `q`.

    Args:
        goal: (n, nj) commanded angles, rad, NaN where missing.
        q: (n, nj) measured angles without wraps, rad; without any in an episode, its angles are not shifted.
        episode: (n,) episode number of each row; None for a single episode.
    """
    straight, _ = straightened(goal, episode=episode)
    # the median of an episode's readings; 0 if there are none
    away = np.ma.masked_invalid((straight - q) / TURN)
    of_episode = _by_episode(away, episode, lambda part: np.ma.filled(np.ma.median(part, axis=0), 0.0))
    return straight - TURN * np.round(np.ma.getdata(of_episode))


def turned(rec: Recording, limits: Limits, source: Path) -> Recording:
    """Unwrap a recording's measured and commanded angles, with one note; unchanged if none of them wraps.

    Raises:
        UserError: an unwrapped angle is farther from 0 than a recording may hold, `MAX_ANGLE`.
    """
    q, changed = straightened(rec.q, limits.range, rec.episode)
    q_cmd = rec.q_cmd
    if q_cmd is not None:
        goal = beside(q_cmd, q, rec.episode)
        moved = np.any(np.nan_to_num(goal - q_cmd), axis=0)
        q_cmd, changed = (goal if moved.any() else q_cmd), changed | moved
    if not changed.any():
        return rec
    for name, values in (("q", q), ("q_cmd", q_cmd)):
        most = np.zeros(len(rec.joints)) if values is None else np.nanmax(np.abs(values), axis=0, initial=0.0)
        if (far := most > MAX_ANGLE).any():
            key, expected = f"{name}.{rec.joints[int(np.argmax(far))]}", f"at most {MAX_ANGLE / TURN:g} turns"
            got = f"{float(most.max()) / TURN:.3g} turns"
            raise UserError("wraps, and turns too far", file=source, key=key, expected=expected, got=got)
    names = ", ".join(joint for joint, is_changed in zip(rec.joints, changed, strict=True) if is_changed)
    note(f"{source}: angles wrap at a whole turn: straightened, and shifted by whole turns into the range: {names}")
    return replace(rec, q=q, q_cmd=q_cmd)


def _unwrapped(q: np.ndarray) -> np.ndarray:
    """Remove steps of a whole turn from angles (n,)."""
    step = np.diff(q)
    turns = np.round(step / TURN)
    turns[np.abs(step - TURN * turns) > NEAR] = 0
    return q - TURN * np.concatenate([[0.0], np.cumsum(turns)])


def _into(q: np.ndarray, low: float, high: float) -> np.ndarray:
    """Shift angles (n,) by whole turns into the range; unchanged if no shift brings them there."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return q
    centre = round(float((np.median(q) - (low + high) / 2) / TURN))

    def outside(turns: int) -> tuple[float, int]:
        moved = q - TURN * turns
        return float(np.mean((moved < low - SLACK) | (moved > high + SLACK))), abs(turns)

    best = min((0, centre - 1, centre, centre + 1), key=outside)
    return q - TURN * best if outside(best)[0] < WITHIN else q


def _by_episode(values: np.ndarray, episode: np.ndarray | None, of: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Compute a value (nj,) for each episode and repeat it in the episode's rows, (n, nj)."""
    out = np.empty_like(values)
    breaks = [] if episode is None else np.flatnonzero(np.diff(episode) != 0) + 1
    for rows in np.split(np.arange(len(values)), breaks):
        out[rows] = of(values[rows]) if len(rows) else 0
    return out
