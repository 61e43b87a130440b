"""Interpolate the robot's joint angles to the times at which pictures were taken."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from vispeg.recordings.recording import Recording

GAP = 3.5  # sample periods: in a longer gap without readings the angles are unknown


def joints_at(rec: Recording, time: np.ndarray, episode: np.ndarray | None = None) -> np.ndarray:
    """Interpolate measured joint angles to any times, by a cubic spline through the readings of each episode.

    Args:
        rec: the recording.
        time: (n,) s.
        episode: (n,) the episode of each; by default the first.

    Returns:
        (n, nj) rad; NaN before the first and after the last reading of an episode, and inside gaps. A joint with fewer
        than four readings in an episode is NaN throughout.
    """
    time = np.asarray(time, float)
    episodes = np.zeros(len(rec.time), np.int64) if rec.episode is None else rec.episode
    wanted = np.full(len(time), episodes[0]) if episode is None else np.asarray(episode)
    out = np.full((len(time), rec.q.shape[1]), np.nan)
    for number in np.unique(wanted):
        rows, asked = episodes == number, wanted == number
        for j in range(rec.q.shape[1]):
            good = rows & np.isfinite(rec.q[:, j])
            if good.sum() >= 4:
                out[asked, j] = _along(rec.time[good], rec.q[good, j], time[asked], 1 / rec.rate_hz)
    return out


def _along(clock: np.ndarray, values: np.ndarray, time: np.ndarray, period: float) -> np.ndarray:
    """Evaluate the spline through (m,) readings at `time` (n,); NaN outside their range and in gaps."""
    angles = CubicSpline(clock, values, extrapolate=False)(time)
    after = np.clip(np.searchsorted(clock, time), 1, len(clock) - 1)
    between = clock[after] - clock[after - 1]
    return np.where((between > GAP * period) & (clock[after] != time) & (clock[after - 1] != time), np.nan, angles)
