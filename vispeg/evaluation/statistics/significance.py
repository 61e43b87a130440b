"""Exact tests on paired episodes, and Holm's correction for several of them.

Sources: Q. McNemar, Psychometrika 12 (1947) 153 (exact form: binomial on the discordant pairs); S. Holm, Scandinavian
Journal of Statistics 6 (1979) 65; sample size: R. J. Connor, Biometrics 43 (1987) 207.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, norm

from vispeg.core.errors import UserError

ALPHA, POWER = 0.05, 0.8
FEWEST_DISCORDANT = 6  # 2 * 0.5^5 = 0.06 > 0.05: with five, no outcome is significant


@dataclass(frozen=True)
class McNemar:
    """Two-sided exact test that two paired success rates are equal.

    Attributes:
        first_only, second_only: pairs in which only the one succeeded.
        n: pairs.
        p: p-value.
    """

    first_only: int
    second_only: int
    n: int
    p: float

    @property
    def can_tell(self) -> bool:
        """Whether any split of this many discordant pairs could have been significant at 5 %."""
        return self.first_only + self.second_only >= FEWEST_DISCORDANT


def mcnemar(first: np.ndarray, second: np.ndarray) -> McNemar:
    """The exact test on (n,) paired outcomes; p = 1 where no pair is discordant."""
    first, second = np.asarray(first, bool).ravel(), np.asarray(second, bool).ravel()
    if first.shape != second.shape or not len(first):
        raise UserError(
            "not paired outcomes", expected="two sequences of one length >= 1", got=(first.size, second.size)
        )
    b, c = int(np.sum(first & ~second)), int(np.sum(~first & second))
    return McNemar(b, c, len(first), float(binomtest(b, b + c).pvalue) if b + c else 1.0)


def holm(p: Sequence[float]) -> list[float]:
    """Adjusted p-values: the j-th smallest of m is multiplied by m - j + 1, kept monotone and at most 1."""
    order, adjusted, worst = np.argsort(p, kind="stable"), [0.0] * len(p), 0.0
    for rank, index in enumerate(order):
        worst = max(worst, min(1.0, (len(p) - rank) * float(p[index])))
        adjusted[int(index)] = worst
    return adjusted


def pairs_needed(difference: float, discordant: float, alpha: float = ALPHA, power: float = POWER) -> int:
    """Pairs with which McNemar's test finds `difference` with probability `power`.

    n = (z_{1-alpha/2} sqrt(psi) + z_{power} sqrt(psi - d^2))^2 / d^2, with psi the share of discordant pairs, >= d.

    Raises:
        UserError: a difference that is not within (0, 1].
    """
    d = abs(difference)
    if not 0 < d <= 1:
        raise UserError("not a difference of two success rates", expected="0 < difference <= 1", got=difference)
    psi = min(max(discordant, d), 1.0)
    root = norm.ppf(1 - alpha / 2) * math.sqrt(psi) + norm.ppf(power) * math.sqrt(max(psi - d * d, 0.0))
    return math.ceil(float(root / d) ** 2)
