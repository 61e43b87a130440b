"""Test the stated units of two signals against each other by the slope between them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vispeg.recordings.columns import columns_of
from vispeg.recordings.recording import Recording

SPAN = 0.1  # s over which speeds are summed: encoder noise and a filter's delay matter little there
MOST_FACTOR, TOGETHER = 1.5, 0.9  # largest factor due to filtering of speeds; least correlation for a slope to count
CORRECTIONS = (  # (slope of speeds over the change of angles, the correction that it suggests)
    (180 / math.pi, "deg/s for dq, or rad for q"),
    (math.pi / 180, "deg for q, or rad/s for dq"),
    (1e3, "ms for the time"),
    (1e-3, "s for the time"),
    (60 / (2 * math.pi), "rpm for dq"),
    (-1.0, "the other sign for dq"),
)


@dataclass(frozen=True)
class Doubt:
    """An implausible property of a recording, and the unit that would explain it.

    Attributes:
        key: the columns concerned.
        said: what is implausible, as a clause.
        likely: the unit that would make it plausible; empty if none would.
        sure: whether it follows from two measured signals, independently of the limits in the robot's file.
        scale: whether the cause is the sensor scale of some joints instead of a unit.
    """

    key: str
    said: str
    likely: str
    sure: bool = False
    scale: bool = False

    @property
    def line(self) -> str:
        """Return the full message for the user."""
        why = "the sensor's scale is wrong" if self.scale else "a unit is wrong"
        return f"{self.key}: {self.said}: {why}" + (f", likely {self.likely}" if self.likely else "")


def slope(x: np.ndarray, y: np.ndarray, least: float = 0.7) -> float | None:
    """Return the least-squares slope of y over x, all columns together; None if they hardly move or correlate."""
    good = np.isfinite(x) & np.isfinite(y)
    if np.count_nonzero(good) < 10:
        return None
    a, b = x[good] - x[good].mean(), y[good] - y[good].mean()
    if not (a @ a > 0 and b @ b > 0):
        return None
    together = float(a @ b) / math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / float(a @ a) if together > least else None


def against_speeds(rec: Recording, inside: np.ndarray, period: float) -> list[Doubt]:
    """Compare measured speeds with the slope of the angles; return a doubt for each wrong factor (unit, sign, clock).

    Joint by joint, speeds integrated over `SPAN` are compared with the change of the angle: nothing is differentiated.

    Args:
        rec: recording with `dq`.
        inside: (n - 1,) bool, whether a row step stays within an episode.
        period: sample period, s.
    """
    if rec.dq is None:
        return []
    step, lag = np.where(inside, np.diff(rec.time), np.nan), max(1, round(SPAN / period))
    ratios = [_ratio(rec.q[:, j], rec.dq[:, j], step, lag) for j in range(rec.q.shape[1])]
    known = {j: ratio for j, ratio in enumerate(ratios) if ratio is not None}  # a joint at rest has none
    groups: dict[str, dict[int, float]] = {}
    for j, ratio in known.items():
        if not 1 / MOST_FACTOR < ratio < MOST_FACTOR:
            likely = next((said for factor, said in CORRECTIONS if _alike(ratio, factor)), "")
            groups.setdefault(likely, {})[j] = ratio
    return [_doubt(rec, likely, wrong, len(known)) for likely, wrong in groups.items()]


def _alike(ratio: float, other: float) -> bool:
    return 0.8 < ratio / other < 1.25


def _doubt(rec: Recording, likely: str, wrong: dict[int, float], known: int) -> Doubt:
    """State what is wrong with the speeds of the joints `wrong` (index -> ratio), of `known` joints with a ratio."""
    names, each = columns_of("dq", rec.joints), sorted(wrong.values())
    ratio = float(np.median(each))
    same = all(_alike(one, ratio) for one in each)
    every = len(wrong) == len(names)
    columns = f"{names[0]} ... {names[-1]}" if every and len(names) > 1 else ", ".join(names[j] for j in wrong)
    said = f"{ratio:.3g}" if same else f"{each[0]:.3g} to {each[-1]:.3g}"
    # If all joints that move are wrong by the same factor, and no unit explains it, the time is likely wrong by it.
    # Where only one joint of several moves, its own scale is as likely, so no rate is suggested.
    shared = same and len(wrong) == known and (every or known > 1)
    clock = f"{ratio * rec.rate_hz:.4g} samples a second" if shared and not likely else ""
    said = f"measured speeds are {said} times the change of the angles"
    return Doubt(columns, said, likely or clock, sure=bool(likely), scale=not (likely or clock))


def _ratio(q: np.ndarray, dq: np.ndarray, step: np.ndarray, lag: int) -> float | None:
    """Return the slope of integrated speeds over changes of angle, from (n,) each; None if they hardly correlate."""
    if len(q) <= lag:
        return None
    move = 0.5 * (dq[1:] + dq[:-1]) * step
    path = np.concatenate([[0.0], np.nancumsum(move)])
    lost = np.concatenate([[0], np.cumsum(np.isnan(move))])
    change, summed = q[lag:] - q[:-lag], path[lag:] - path[:-lag]
    summed[lost[lag:] != lost[:-lag]] = np.nan
    ahead = slope(change, summed, TOGETHER)
    back = slope(-change, summed, TOGETHER)  # `slope` knows no negative one
    return ahead if back is None else -back
