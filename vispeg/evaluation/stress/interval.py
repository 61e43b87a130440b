"""Decide whether a measurement is good enough for a policy: success hardly changes between the ends of its interval."""

from __future__ import annotations

from vispeg.core.counts import count
from vispeg.core.effect import EffectInstance

POINT = 0.01  # largest change of success, as a share, for which a measurement is good enough


def ends(placed: EffectInstance) -> tuple[dict[str, float], dict[str, float]]:
    """Return an effect's values twice: at the low ends of their intervals, and at the high ends.

    Values without an interval are the same in both.
    """
    low = {k: v.value if v.low is None else v.low for k, v in placed.params.items()}
    return low, {k: v.value if v.high is None else v.high for k, v in placed.params.items()}


def verdict(low: float, high: float, episodes: int) -> str:
    """Return the verdict on a measurement.

    Args:
        low, high: 95 % interval of success at one end of the measurement's interval minus success at the other, shares.
        episodes: number of episodes played.
    """
    if max(abs(low), abs(high)) < POINT:
        return "enough, stop measuring"
    if low > POINT or high < -POINT:
        return "measure on"
    return f"{count(episodes, 'episode')} cannot tell whether it is under a point"


def words(moved: float, low: float, high: float, said: str) -> str:
    """Return a sentence on the change of success over the interval (a share), its 95 % interval and the verdict."""
    return f"over the interval success moves by {100 * moved:+.1f} points [{100 * low:+.1f}, {100 * high:+.1f}]: {said}"
