"""The phase of a joint's motion: where between two turning points it is."""

from __future__ import annotations

import numpy as np

from vispeg.recordings.checks.excitation import moves


def phase(time: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """Return each joint's phase in its cycle: 0 at a lower turning point, 0.5 at an upper one, 1 at the next lower.

    From one turning point to the next it grows evenly in time. So it is defined for motion of any shape, and for a sine
    it is the usual phase. Just above 0 and 0.5 is just after a reversal, where dry friction, play and hysteresis show;
    0.25 and 0.75 are the middles of the upward and downward strokes.

    Args:
        time: (m,) s, increasing.
        dq: (m, nj) rad/s, smoothed. Speeds below a small share of a joint's peak do not count as a change of
            direction, so that noise makes no turning point.

    Returns:
        (m, nj), NaN before a joint's first and after its last turning point, as those strokes are not complete.
    """
    out = np.full(dq.shape, np.nan)
    for j, speed in enumerate(dq.T):
        moving = np.flatnonzero(moves(speed))
        turned = np.flatnonzero(np.diff(np.sign(speed[moving])) != 0)
        turns = np.array([_crossing(time, speed, moving[k], moving[k + 1]) for k in turned])
        for start, stop, first in zip(turns, turns[1:], moving[turned + 1], strict=False):
            rows = slice(*np.searchsorted(time, (start, stop)))
            stroke = 0.5 * (time[rows] - start) / (stop - start)
            out[rows, j] = stroke if speed[first] > 0 else 0.5 + stroke
    return out


def _crossing(time: np.ndarray, speed: np.ndarray, before: int, after: int) -> float:
    """Return the time of zero speed between two rows of opposite sign, by linear interpolation."""
    share = speed[before] / (speed[before] - speed[after])
    return float(time[before] + share * (time[after] - time[before]))
