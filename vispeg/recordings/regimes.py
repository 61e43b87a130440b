"""Contact regime at each instant: free air, pressing, sliding, inserted, or impact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

REGIMES = ("free", "press", "slide", "hole", "impact")  # as JSON files have them
INSIDE = REGIMES[3]  # of what is inserted
FREE, PRESS, SLIDE, INSIDE, IMPACT = range(len(REGIMES))


@dataclass(frozen=True)
class Thresholds:
    """Where one regime ends and another begins.

    Attributes:
        touch: contact force from which the tool touches, N; it does until the force is under half of that.
        slide: speed of the tip along the surface from which it slides, m/s.
        inside: depth of the tip in the goal from which it counts as inserted, m.
        hit: speed of the tip against what it meets from which the first touch is an impact, m/s.
        impact: for how long after the first touch, s.
    """

    touch: float = 2.0
    slide: float = 0.003
    inside: float = 0.001
    hit: float = 0.01
    impact: float = 0.03


def touching(force: np.ndarray, threshold: float) -> np.ndarray:
    """(n,) bool: force (n,) N rose to `threshold` and has not fallen under half of it since; NaN touches nothing."""
    on, off = force >= threshold, ~(force >= 0.5 * threshold)
    change = np.where(on, 1, np.where(off, -1, 0))
    last = np.maximum.accumulate(np.where(change != 0, np.arange(len(force)), 0))
    return change[last] > 0


def regimes(
    time: np.ndarray,
    force: np.ndarray,
    speed: np.ndarray,
    approach: np.ndarray,
    inside: np.ndarray | None = None,
    thresholds: Thresholds | None = None,
) -> np.ndarray:
    """Give the regime of each sample of one episode.

    Args:
        time: (n,) s, increasing.
        force: (n,) N, length of the contact force.
        speed: (n,) m/s, of the tip along the surface that it touches.
        approach: (n,) m/s, of the tip in all.
        inside: (n,) m, depth of the tip in the goal where it is over it, else negative; None where there is no goal.
        thresholds: where one regime ends and another begins.

    Returns:
        (n,) int, numbers of `REGIMES`.
    """
    th = thresholds or Thresholds()
    touch = touching(force, th.touch)
    out = np.where(touch, np.where(speed > th.slide, SLIDE, PRESS), FREE)
    if inside is not None:
        out[touch & (inside > th.inside)] = INSIDE
    before = np.concatenate([[False], touch[:-1]])
    for first in np.flatnonzero(touch & ~before):
        start = max(0, int(np.searchsorted(time, time[first] - th.impact)))
        if first and np.nanmax(approach[start : first + 1], initial=0.0) > th.hit:
            stop = int(np.searchsorted(time, time[first] + th.impact, side="right"))
            out[first:stop] = IMPACT
    return out
