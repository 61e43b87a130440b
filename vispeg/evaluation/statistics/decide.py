"""When a difference is called one, when none, and when these data cannot tell.

The rule, the same in every table: with d the difference of two success rates and its 95 % interval,

* different: the interval excludes 0, and where several comparisons stand side by side, Holm's adjusted p is below 5 %;
* equal: the interval lies within +-5 points (the margin);
* otherwise these data cannot tell. The number of paired episodes that would find a difference as large as the margin
  with 80 % power is then said; it follows from the measured share of discordant pairs.
"""

from __future__ import annotations

import math
from typing import Literal

from vispeg.evaluation.statistics.intervals import Estimate, Z
from vispeg.evaluation.statistics.significance import ALPHA, pairs_needed

MARGIN = 0.05
RULE = (
    "Two success rates are called different where the 95 % interval of their difference excludes 0 and, where several "
    "comparisons stand side by side, McNemar's exact p after Holm's correction is below 5 %. They are called equal "
    "where the interval lies within 5 points either way. Otherwise these data cannot tell, and the number of pairs is "
    "said that would find 5 points with 80 % power at the share of discordant pairs that was seen."
)
CANNOT_TELL = "these data cannot tell"
Verdict = Literal["different", "equal", "these data cannot tell"]


def decide(difference: Estimate, p: float | None = None, margin: float = MARGIN) -> Verdict:
    """The verdict on a difference; `p` is the adjusted p-value where there is one."""
    if difference.excludes(0.0) and (p is None or p < ALPHA):
        return "different"
    if -margin <= difference.low and difference.high <= margin:
        return "equal"
    return CANNOT_TELL


def rate_words(rate: Estimate) -> str:
    """What the episodes can tell of a success rate: `4 of 4: 51 to 100 %`."""
    return f"{round(rate.value * rate.n)} of {rate.n}: {100 * rate.low:.0f} to {100 * rate.high:.0f} %"


def episodes_needed(rate: Estimate) -> int | None:
    """Episodes that would tell one network's success rate to within the margin, None where these do.

    Wald's number for a half-width as large as the margin, at the rate within the interval that needs most.
    """
    if max(rate.high - rate.value, rate.value - rate.low) <= MARGIN:
        return None
    p = min(max(rate.low, 0.5), rate.high)
    return math.ceil(Z**2 * p * (1 - p) / MARGIN**2)


def needed(discordant: float, margin: float = MARGIN) -> int:
    """Paired episodes after which the margin would be found with 80 % power, given the share of discordant pairs."""
    return pairs_needed(margin, discordant)


def gap_words(gap: Estimate, margin: float = MARGIN) -> str:
    """A gap (reference minus target) in plain words, in points of success."""
    verdict, size = decide(gap, margin=margin), f"{100 * abs(gap.value):.0f}"
    ends = sorted((100 * gap.low, 100 * gap.high), key=abs)
    if verdict == "equal":
        return f"holds, to within {100 * max(abs(gap.low), abs(gap.high)):.0f} points"
    if verdict == "different":
        word = "loses" if gap.value > 0 else "gains"
        return f"{word} {size} points ({abs(ends[0]):.0f} to {abs(ends[1]):.0f})"
    worst, best = round(100 * gap.high), round(-100 * gap.low)
    return f"{CANNOT_TELL}: anything from {worst} points lost to {best} gained"
