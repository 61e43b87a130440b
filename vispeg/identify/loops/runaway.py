"""Leave out stretches of a recording in which a closed loop lost the arm.

At the limit of stability (readings that come late) or in a singular posture (operational space control) a loop may move
the arm at many times its rated speed. There errors grow from tick to tick: noise decides the motion, the right model
diverges from the recording like any other, and this error dominates that of the rest of the recording. So such a
stretch is excluded, and so is what follows, because in a loop this close to instability the error of an inexact start
state takes seconds to decay. Only if too little comes before it, the part after it is used.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.rules import RULES
from vispeg.recordings.differentiate import smooth, spanned
from vispeg.recordings.recording import Recording
from vispeg.recordings.windows import taken
from vispeg.robots.model import RobotModel

MOTION_HZ = 50.0  # bandwidth of the speeds that are checked
RUNAWAY = (
    "{}: the loop loses the arm (a joint exceeds {:g} times its rated speed): {:.3g} of {:.3g} s can be compared, "
    "from {:.3g} s on"
)


def without_runaway(rec: Recording, robot: RobotModel, least: float) -> Recording:
    """Return the recording with only the first part of each episode longer than `least` s without loss of control.

    Return `rec` itself if the arm is never lost, if no loop is known that could lose it, if the robot's file states no
    speed limits, or if nothing longer than `least` seconds would be left.
    """
    if rec.control.mode not in ("position", "osc"):
        return rec
    episode = np.zeros(len(rec.time), int) if rec.episode is None else rec.episode
    runs = [np.flatnonzero(episode == e) for e in np.unique(episode)]
    lost = [_lost(rec.time[rows], rec.q[rows], robot.velocity_limit) for rows in runs]
    if not any(off.any() for off in lost):
        return rec
    stretches = []
    for rows, off in zip(runs, lost, strict=True):
        long = [part for part in _stretches(rows[~off]) if rec.time[part[-1]] - rec.time[part[0]] > least]
        stretches += [(part[0], part[-1] + 1) for part in long[:1]]
    return taken(rec, stretches) if stretches else rec


def said(before: Recording, after: Recording) -> str:
    """Return a message on what of the recording `before` was left out in `after`."""
    seconds = [spanned(rec.time, rec.episode) for rec in (after, before)]
    return RUNAWAY.format(before.name, RULES.runaway_speed, *seconds, after.elapsed[0])


def _lost(time: np.ndarray, q: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Return the samples (n,) bool from shortly before to some time after one at which a joint is far too fast.

    `limit` (nj,) rad/s has the joints' rated speeds.
    """
    _, dq, _ = smooth(time, q, MOTION_HZ)
    fast = time[(np.abs(dq) > RULES.runaway_speed * limit).any(axis=1)]  # a missing reading is not fast
    # the last fast sample that is not too far ahead; it must not be too far back either
    last = np.searchsorted(fast, time + RULES.runaway_before, side="right") - 1
    return (last >= 0) & (fast[last] >= time - RULES.settle_observed) if len(fast) else np.zeros(len(time), bool)


def _stretches(rows: np.ndarray) -> list[np.ndarray]:
    """Return runs of consecutive row numbers."""
    return [run for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(run)]
