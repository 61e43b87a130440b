"""Mends what loggers do to a clock (rows twice, steps back, rare commands) and puts other sensors' signals on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note

COMMANDS = ("q_cmd", "dq_cmd")
LONGEST = 3.5  # times the usual distance of two commands: where none comes for longer, none is known
NAMED = 3  # steps back that are named one by one
REACH = 1.5  # periods of the other signal: where it is silent for longer it has a gap, not to be bridged


def cleaned(columns: dict[str, np.ndarray], source: Path, first_row: int = 0) -> dict[str, np.ndarray]:
    """Drop repeated rows, cut where the clock steps back, hold commands between two of them; a note says each.

    A row that repeats the time of the one before with other values is not touched: which one counts is not known.

    Args:
        columns: `time` (n,) s, maybe `episode`, and signals.
        source: what notes and errors name.
        first_row: what the source calls its first sample.

    Raises:
        UserError: two rows of one time with other values.
    """
    time = columns["time"]
    if len(time) < 2 or not np.isfinite(time).all():
        return columns
    episode = columns.get("episode", np.zeros(len(time)))
    same = (np.diff(time) == 0) & (np.diff(episode) == 0)
    if same.any():
        again = same.copy()
        for values in columns.values():
            again &= (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
        if (same & ~again).any():
            row = int(np.flatnonzero(same & ~again)[0]) + 1
            raise UserError(
                "two rows of one time with other values",
                file=source,
                key=f"row {first_row + row}",
                expected="a time of its own for every reading",
                got=float(time[row]),
            )
        keep = np.concatenate([[True], ~again])
        note(f"{source}: {int(again.sum())} rows that repeat the one before with its time are dropped")
        columns = {name: values[keep] for name, values in columns.items()}
        rows = first_row + np.flatnonzero(keep)
    else:
        rows = first_row + np.arange(len(time))
    return _held(_cut(columns, source, rows), source)


def counted(episode: np.ndarray | None, rows: int) -> np.ndarray:
    """Give the number of each sample in its episode, (rows,)."""
    if episode is None:
        return np.arange(rows, dtype=float)
    starts = np.flatnonzero(np.diff(episode, prepend=np.nan) != 0)
    return np.arange(rows, dtype=float) - np.repeat(starts, np.diff(np.append(starts, rows)))


def _cut(columns: dict[str, np.ndarray], source: Path, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Give a new episode wherever the clock steps back inside one."""
    time = columns["time"]
    inside = np.ones(len(time) - 1, bool) if "episode" not in columns else np.diff(columns["episode"]) == 0
    back = np.flatnonzero(inside & (np.diff(time) < 0))
    if not len(back):
        return columns
    starts = np.zeros(len(time))
    starts[back + 1] = 1
    if "episode" in columns:
        starts[1:][~inside] = 1
    named = ", ".join(f"by {time[i] - time[i + 1]:.4g} s at row {rows[i + 1]}" for i in back[:NAMED])
    more = f" and {len(back) - NAMED} times more" if len(back) > NAMED else ""
    note(f"{source}: the clock stepped back {named}{more}: an episode ends there, and the next begins")
    return columns | {"episode": np.cumsum(starts)}


def _held(columns: dict[str, np.ndarray], source: Path) -> dict[str, np.ndarray]:
    """Commands that come less often than readings hold until the next one."""
    time, out, held = columns["time"], dict(columns), 0
    episode = columns.get("episode", np.zeros(len(time)))
    for name, values in columns.items():
        there = np.isfinite(values)
        if name.partition(".")[0] not in COMMANDS or there.all() or there.sum() < 2:
            continue
        usual = np.median(np.diff(np.flatnonzero(there)))
        if usual < 2:
            continue  # commands come with every reading, but for some that are missing
        last = np.maximum.accumulate(np.where(there, np.arange(len(values)), -1))
        known = (last >= 0) & (np.arange(len(values)) - last <= LONGEST * usual) & (episode[last] == episode)
        out[name] = np.where(known, values[np.maximum(last, 0)], np.nan)
        held += 1
    if held:
        note(f"{source}: commands come less often than readings: each holds until the next")
    return out


def linear(clock: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (m, k) at `time` (m,), interpolated at `clock` (n,); NaN outside and inside gaps. Returns (n, k)."""
    out = np.stack([np.interp(clock, time, column, np.nan, np.nan) for column in values.T], axis=1)
    out[_in_gap(clock, time)] = np.nan
    return out


def poses(clock: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Poses (m, 7) x y z qw qx qy qz at `clock`: positions linear, orientations along the shorter arc. (n, 7).

    slerp: sin((1-s) a)/sin(a) q0 + sin(s a)/sin(a) q1 with cos(a) = q0.q1, s the share of the interval that has passed.
    """
    out = linear(clock, time, values)
    quaternion = values[:, 3:] / np.maximum(np.linalg.norm(values[:, 3:], axis=1, keepdims=True), 1e-12)
    right = np.clip(np.searchsorted(time, clock), 1, max(len(time) - 1, 1)) if len(time) > 1 else None
    if right is None:
        return out
    q0, q1 = quaternion[right - 1], quaternion[right]
    cosine = np.sum(q0 * q1, axis=1, keepdims=True)
    q1, cosine = np.where(cosine < 0, -q1, q1), np.minimum(np.abs(cosine), 1.0)
    share = ((clock - time[right - 1]) / (time[right] - time[right - 1]))[:, None]
    angle = np.arccos(cosine)
    small = angle < 1e-6
    sine = np.where(small, 1.0, np.sin(angle))
    w0 = np.where(small, 1 - share, np.sin((1 - share) * angle) / sine)
    w1 = np.where(small, share, np.sin(share * angle) / sine)
    mixed = w0 * q0 + w1 * q1
    mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
    out[:, 3:] = np.where(np.isnan(out[:, 3:]), np.nan, mixed)
    return out


def hold(clock: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Commands (m, k) in force at `clock` (n,): NaN before the first. Returns (n, k).

    A command follows the reading it was computed from by a fraction of a tick, yet belongs in its row. So where
    commands come about as often as readings, or more often, the nearest within half a period of the readings counts.
    """
    out = np.full((len(clock), values.shape[1]), np.nan)
    last = np.searchsorted(time, clock, side="right") - 1
    out[last >= 0] = values[last[last >= 0]]
    if len(time) < 2 or len(clock) < 2:
        return out
    period = float(np.median(np.diff(clock)))
    if float(np.median(np.diff(time))) < 1.25 * period:
        following = np.clip(np.searchsorted(time, clock), 0, len(time) - 1)
        before = np.clip(following - 1, 0, None)
        nearest = np.where(np.abs(time[before] - clock) < np.abs(time[following] - clock), before, following)
        close = np.abs(time[nearest] - clock) <= 0.5 * period
        out[close] = values[nearest[close]]
    return out


def _in_gap(clock: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Which of `clock` fall strictly between two samples that are too far apart."""
    if len(time) < 3:
        return np.zeros(len(clock), bool)
    steps = np.diff(time)
    right = np.clip(np.searchsorted(time, clock), 1, len(time) - 1)
    wide = steps[right - 1] > REACH * np.median(steps)
    return wide & (clock > time[right - 1]) & (clock < time[right])
