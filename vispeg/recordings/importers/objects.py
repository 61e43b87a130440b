"""Import an object's tosses from a NumPy archive: `state` (n, 7) or (n, 13), and the first row of each toss."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.arrays import read_arrays
from vispeg.recordings.importers.clock import counted
from vispeg.recordings.objects import ObjectRecording, rates
from vispeg.recordings.tables.table import MAX_BYTES

NORM_OFF = 1e-2  # tolerated deviation of a quaternion's norm from 1
MOST = 1e6  # bound of every number in `state`


def import_object(
    source: Path, name: str, rate_hz: float | None, first: int = 0, last: int | None = None
) -> ObjectRecording:
    """Import an object recording from an .npz file; nothing in it is ever unpickled.

    Arrays: `state` (n, 13), position (m), quaternion (w x y z), velocity (m/s, world), angular velocity (rad/s, body's
    frame), or (n, 7) without velocities; `start` (k,), first rows of the tosses (and the end, n, if it is listed);
    `time` (n,) s, where `rate_hz` is not stated.

    Args:
        source: the .npz file.
        name: the object's body in its model.
        rate_hz: samples a second, equally spaced; None where the archive has `time`.
        first, last: range of tosses to import, `last` excluded; None imports all from `first` on.

    Raises:
        UserError: the file is damaged, an array is absent or has the wrong shape, or no toss is left.
    """
    arrays = read_arrays(source, most=MAX_BYTES)
    state = _array(arrays, "state", source)
    if state.ndim != 2 or state.shape[1] not in (7, 13) or not len(state):
        raise UserError("has the wrong shape", file=source, key="state", expected="(n, 7) or (n, 13)", got=state.shape)
    bad = np.flatnonzero(~np.isfinite(state).all(axis=1) | ~(np.abs(state) < MOST).all(axis=1))
    norm = np.linalg.norm(np.where(np.isfinite(state), state, 0.0)[:, 3:7], axis=1)
    bad = np.union1d(bad, np.flatnonzero(np.abs(norm - 1) > NORM_OFF))
    if len(bad):
        expected = f"numbers below {MOST:g}, columns 3 to 6 (from 0) a unit quaternion w x y z"
        raise UserError("is not a pose", file=source, key=f"state, row {bad[0]}", expected=expected)
    edges = _edges(arrays, len(state), source)
    count = len(edges) - 1
    stop = count if last is None else last
    if not 0 <= first < stop <= count:
        expected = f"some of 0:{count}"
        raise UserError("no such tosses", file=source, key="--episodes", expected=expected, got=f"{first}:{stop}")
    rows = slice(edges[first], edges[stop])
    episode = np.repeat(np.arange(count), np.diff(edges))[rows]
    if rate_hz is None:
        if "time" not in arrays:
            raise UserError("has no `time`", file=source, key="--rate-hz", expected="samples a second")
        time = _array(arrays, "time", source)
        if time.shape != (len(state),):
            raise UserError("has the wrong shape", file=source, key="time", expected=(len(state),), got=time.shape)
        if not np.isfinite(time).all():
            raise UserError("is not finite", file=source, key="time", expected="seconds, rising in each toss")
        time, steps = time[rows], np.diff(time[rows])[np.diff(episode) == 0]
        if not len(steps) or steps.min() <= 0:
            raise UserError("does not increase", file=source, key="time", expected="seconds, rising in each toss")
        rate_hz = float(1 / np.median(steps))
    else:
        time = counted(episode, len(episode), rate_hz, source, arrays)
    pose = state[rows, :7].copy()
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    rate = state[rows, 7:] if state.shape[1] == 13 else rates(pose, time, episode)
    return ObjectRecording(source, name, rate_hz, time, pose, rate, episode, {}, "toss", f"from {source.name}")


def _array(arrays: dict[str, np.ndarray], key: str, source: Path) -> np.ndarray:
    if key not in arrays:
        raise UserError("no such array", file=source, key=key, choices=sorted(arrays))
    if arrays[key].dtype.kind not in "fiu":
        raise UserError("is not numeric", file=source, key=key, got=str(arrays[key].dtype))
    return arrays[key].astype(float)


def _edges(arrays: dict[str, np.ndarray], n: int, source: Path) -> np.ndarray:
    """Return the first row of each toss, then n."""
    if "start" not in arrays:
        return np.array([0, n])
    start = _array(arrays, "start", source)
    edges = np.unique(np.append(start, n)) if np.isfinite(start).all() else start
    valid = start.ndim == 1 and len(start) > 0 and np.isfinite(start).all() and (np.floor(start) == start).all()
    if not valid or edges[0] != 0 or edges[-1] != n or (np.diff(start) <= 0).any():
        raise UserError("is not a list of first rows", file=source, key="start", expected=f"rising from 0, at most {n}")
    return edges.astype(int)
