"""When a measurement is good enough for a policy: how far success moves between the two ends of its interval."""

from __future__ import annotations

from vispeg.core.effect import EffectInstance

POINT = 0.01  # of success: below it a measurement is good enough


def ends(placed: EffectInstance) -> tuple[dict[str, float], dict[str, float]]:
    """All values of an effect with those that have an interval at its low and at its high end."""
    low = {k: v.value if v.low is None else v.low for k, v in placed.params.items()}
    return low, {k: v.value if v.high is None else v.high for k, v in placed.params.items()}


def verdict(low: float, high: float, episodes: int) -> str:
    """Return the verdict of the 95 % interval of a change of success.

    Args:
        low, high: of success at one end of the measurement's interval less at the other, shares.
        episodes: played.
    """
    if max(abs(low), abs(high)) < POINT:
        return "enough, stop measuring"
    if low > POINT or high < -POINT:
        return "measure on"
    return f"{episodes} episodes cannot tell whether it is under a point"


def words(moved: float, low: float, high: float, said: str) -> str:
    """Give the change of success over the interval, a share, with its 95 % interval and its verdict."""
    return f"over the interval success moves by {100 * moved:+.1f} points [{100 * low:+.1f}, {100 * high:+.1f}]: {said}"
