"""Resample signals onto the clock of another: measured values, poses, commands."""

from __future__ import annotations

import numpy as np

REACH = 1.5  # periods of the other signal: a longer silence is a gap, which is not interpolated across


def linear(clock: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate values (m, k) at `time` (m,) to `clock` (n,); NaN outside their range and in gaps. Returns (n, k)."""
    out = np.stack([np.interp(clock, time, column, np.nan, np.nan) for column in values.T], axis=1)
    out[_in_gap(clock, time)] = np.nan
    return out


def poses(clock: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate poses (m, 7) x y z qw qx qy qz to `clock`: positions linearly, orientations by slerp. Returns (n, 7).

    slerp along the shorter arc: sin((1-s) a)/sin(a) q0 + sin(s a)/sin(a) q1, cos(a) = q0.q1, s = 0 to 1 from q0 to q1.
    """
    out = linear(clock, time, values)
    if len(time) < 2:
        return out
    quaternion = values[:, 3:] / np.maximum(np.linalg.norm(values[:, 3:], axis=1, keepdims=True), 1e-12)
    right = np.clip(np.searchsorted(time, clock), 1, len(time) - 1)
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
    """Return the commands in force at `clock` (n,), from commands (m, k) at `time` (m,); NaN before the first. (n, k).

    A command is stamped a fraction of a tick after the reading that it was computed from, yet belongs in that row.
    So where commands are at least about as frequent as readings, the nearest one within half a reading period is used.
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
    """Mark the times of `clock` that fall strictly between two samples that are too far apart."""
    if len(time) < 3:
        return np.zeros(len(clock), bool)
    steps = np.diff(time)
    right = np.clip(np.searchsorted(time, clock), 1, len(time) - 1)
    wide = steps[right - 1] > REACH * np.median(steps)
    return wide & (clock > time[right - 1]) & (clock < time[right])
