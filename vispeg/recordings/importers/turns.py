"""Undoes the wrap of angles that are reported within one turn, and shifts them by whole turns into a joint's range."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from vispeg.core.notes import note
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.recording import Recording

TURN = 2 * np.pi
NEAR = (
    np.pi / 2
)  # rad: a step this near to a whole turn is a wrap; no arm moves a quarter of a turn between two samples
WITHIN = (
    0.02  # share of the angles that may lie outside a range which they are shifted into: of a unit that is wrong, more
)
SLACK = 0.1  # rad beyond a stated range, as the ranges in robot files are not exact


def straightened(q: np.ndarray, limits: np.ndarray, episode: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Angles without jumps of whole turns, each joint's shifted by whole turns to where its range holds the most of it.

    Args:
        q: (n, nj) rad, NaN where missing.
        limits: (nj, 2) rad, infinite where not known; then only jumps are undone.
        episode: (n,) of each row; None for one.

    Returns:
        The angles, and the joints (nj,) bool that were changed.
    """
    out = np.array(q, float)
    breaks = [] if episode is None else np.flatnonzero(np.diff(episode) != 0) + 1
    for rows in np.split(np.arange(len(q)), breaks):
        for j in range(q.shape[1]):
            good = rows[np.isfinite(q[rows, j])]
            if len(good) and np.ptp(q[good, j]) <= TURN + SLACK:  # what spans more than a turn does not wrap at one
                out[good, j] = _into(_unwrapped(q[good, j]), *limits[j])
    return out, np.any(np.nan_to_num(out - q), axis=0)


def turned(rec: Recording, limits: Limits, source: Path) -> Recording:
    """Give a recording whose measured and commanded angles do not wrap, with one note. Unchanged where none does."""
    q, changed = straightened(rec.q, limits.range, rec.episode)
    q_cmd = rec.q_cmd
    if q_cmd is not None:
        straight, _ = straightened(q_cmd, np.full_like(limits.range, np.inf) * [-1, 1], rec.episode)
        away = np.nan_to_num(np.round((straight - q) / TURN))
        of_episode = _by_episode(away, rec.episode, lambda some: np.median(some, axis=0))
        goal = straight - TURN * of_episode
        moved = np.any(np.nan_to_num(goal - q_cmd), axis=0)
        q_cmd, changed = (goal if moved.any() else q_cmd), changed | moved
    if not changed.any():
        return rec
    names = ", ".join(joint for joint, is_changed in zip(rec.joints, changed, strict=True) if is_changed)
    note(f"{source}: angles wrap at a whole turn: straightened, and shifted by whole turns into the range: {names}")
    return replace(rec, q=q, q_cmd=q_cmd)


def _unwrapped(q: np.ndarray) -> np.ndarray:
    """Angles (n,) without steps of a whole turn."""
    step = np.diff(q)
    turns = np.round(step / TURN)
    turns[np.abs(step - TURN * turns) > NEAR] = 0
    return q - TURN * np.concatenate([[0.0], np.cumsum(turns)])


def _into(q: np.ndarray, low: float, high: float) -> np.ndarray:
    """Angles (n,) shifted by whole turns into the range; as they are where no shift brings them there."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return q
    centre = round(float((np.median(q) - (low + high) / 2) / TURN))

    def outside(turns: int) -> tuple[float, int]:
        moved = q - TURN * turns
        return float(np.mean((moved < low - SLACK) | (moved > high + SLACK))), abs(turns)

    best = min((0, centre - 1, centre, centre + 1), key=outside)
    return q - TURN * best if outside(best)[0] < WITHIN else q


def _by_episode(values: np.ndarray, episode: np.ndarray | None, of: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Give a value (nj,) of each episode's rows, repeated in them, (n, nj)."""
    out = np.empty_like(values)
    breaks = [] if episode is None else np.flatnonzero(np.diff(episode) != 0) + 1
    for rows in np.split(np.arange(len(values)), breaks):
        out[rows] = of(values[rows]) if len(rows) else 0
    return out
