"""95 % intervals of a success rate, and of a difference of two.

Sources: E. B. Wilson, JASA 22 (1927) 209; T. Tango, Statistics in Medicine 17 (1998) 891 (paired difference, score);
R. G. Newcombe, Statistics in Medicine 17 (1998) 873 (independent difference, method 10).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import binomtest, norm

from vispeg.core.errors import UserError
from vispeg.evaluation.schema.estimate import Interval

LEVEL = 0.95
Z = float(norm.ppf(0.5 + LEVEL / 2))


@dataclass(frozen=True)
class Estimate:
    """A number with its interval.

    Attributes:
        value: the point estimate.
        low, high: the 95 % interval.
        n: episodes behind it (pairs, for a paired difference).
    """

    value: float
    low: float
    high: float
    n: int

    @property
    def half(self) -> float:
        """Half of the interval's width."""
        return (self.high - self.low) / 2

    def excludes(self, value: float = 0.0) -> bool:
        """Whether `value` lies outside the interval."""
        return value < self.low or value > self.high

    def to_json(self) -> Interval:
        """{value, low, high, n}, null for what is not finite."""
        value, low, high = (float(v) if math.isfinite(v) else None for v in (self.value, self.low, self.high))
        return {"value": value, "low": low, "high": high, "n": self.n}


def wilson(successes: int, n: int) -> Estimate:
    """Wilson's score interval of a proportion.

    Raises:
        UserError: no trial, or more successes than trials.
    """
    if n < 1 or not 0 <= successes <= n:
        raise UserError("not a count of successes", expected="0 <= successes <= n, n >= 1", got=f"{successes} of {n}")
    interval = binomtest(int(successes), int(n)).proportion_ci(LEVEL, method="wilson")
    return Estimate(successes / n, float(interval.low), float(interval.high), n)


def paired_difference(first: np.ndarray, second: np.ndarray) -> Estimate:
    """p(first) - p(second) of paired outcomes, by Tango's score interval: the differences that a score test accepts.

    Args:
        first, second: (n,) successes of the same episodes.
    """
    first, second = _paired(first, second)
    b, c, n = int(np.sum(first & ~second)), int(np.sum(~first & second)), len(first)
    value = (b - c) / n
    ends = (_root(b, c, n, -1.0, value, +Z), _root(b, c, n, value, 1.0, -Z))
    return Estimate(value, ends[0], ends[1], n)


def tango_score(b: int, c: int, n: int, delta: float) -> float:
    """The score statistic (standard normal under p1 - p2 = delta), for b and c discordant pairs of n.

    The variance uses the maximum-likelihood discordance p21 under the hypothesis, the larger root of
    A x^2 + B x + C = 0 with A = 2 n, B = -b - c + (2 n - b + c) delta, C = -c delta (1 - delta).
    """
    quad, lin, const = 2.0 * n, -b - c + (2.0 * n - b + c) * delta, -c * delta * (1.0 - delta)
    p21 = (math.sqrt(max(lin * lin - 4.0 * quad * const, 0.0)) - lin) / (2.0 * quad)
    variance = n * (2.0 * p21 + delta * (1.0 - delta))
    gap = b - c - n * delta
    if variance <= 0:
        return 0.0 if gap == 0 else math.copysign(math.inf, gap)
    return gap / math.sqrt(variance)


def unpaired_difference(successes: tuple[int, int], trials: tuple[int, int]) -> Estimate:
    """p1 - p2 of independent samples, from their two Wilson intervals (Newcombe's method 10). n: the smaller sample."""
    p1, p2 = (wilson(s, n) for s, n in zip(successes, trials, strict=True))
    value = p1.value - p2.value
    low = value - math.hypot(p1.value - p1.low, p2.high - p2.value)
    high = value + math.hypot(p1.high - p1.value, p2.value - p2.low)
    return Estimate(value, low, high, min(trials))


def _root(b: int, c: int, n: int, low: float, high: float, target: float) -> float:
    """Where the score, which falls with delta, equals `target` between `low` and `high`."""
    eps = 1e-12
    low, high = low + eps, high - eps

    def excess(delta: float) -> float:
        score = tango_score(b, c, n, delta)
        return max(min(score, 1e6), -1e6) - target

    if low >= high or excess(low) <= 0:
        return low
    return high if excess(high) >= 0 else float(brentq(excess, low, high, xtol=1e-10))


def _paired(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    first, second = np.asarray(first, bool), np.asarray(second, bool)
    if first.shape != second.shape or first.ndim != 1 or not len(first):
        raise UserError(
            "not paired outcomes", expected="two sequences of one length >= 1", got=(first.shape, second.shape)
        )
    return first, second
