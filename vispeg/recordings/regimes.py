"""Contact regime at each instant: free air, pressing, sliding, inserted, or impact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

REGIMES = ("free", "press", "slide", "hole", "impact")  # names in JSON files
FREE, PRESS, SLIDE, INSIDE, IMPACT = range(len(REGIMES))  # INSIDE: the tip is inserted


@dataclass(frozen=True)
class Thresholds:
    """Thresholds between regimes.

    Attributes:
        touch: contact force at which a touch begins, N; it ends below half of that.
        slide: least tip speed along the surface that counts as sliding, m/s.
        inside: least depth of the tip in the goal that counts as inserted, m.
        hit: least approach speed of the tip at which a first touch counts as an impact, m/s.
        impact: duration of an impact after the first touch, s.
    """

    touch: float = 2.0
    slide: float = 0.003
    inside: float = 0.001
    hit: float = 0.01
    impact: float = 0.03


def touching(force: np.ndarray, threshold: float) -> np.ndarray:
    """Mark touch (n,) bool: force (n,) N rose to `threshold` and has since stayed above half of it; NaN is no touch."""
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
    """Classify each sample of one episode by contact regime.

    Args:
        time: (n,) s, increasing.
        force: (n,) N, magnitude of the contact force.
        speed: (n,) m/s, tip speed along the touched surface.
        approach: (n,) m/s, total tip speed.
        inside: (n,) m, depth of the tip in the goal if it is horizontally inside the opening, else negative; None
            without goal.
        thresholds: thresholds between regimes.

    Returns:
        (n,) int, indices into `REGIMES`.
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
