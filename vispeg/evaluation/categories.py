"""Test whether the failures on two sides are of the same kinds, and which kinds are more frequent.

There are two questions.

1. Do the kinds of the failures differ? The test is Pearson's chi2 of the 2 x C table of failures, against all tables
   with the same margins (the Freeman-Halton extension of Fisher's test, with tables ordered by chi2; A. Agresti,
   Statistical Science 7 (1992) 131).
2. How often does each kind happen? A kind's share of all episodes is compared as success is. This has an answer also
   where one side hardly fails, as a simulation often does: its failures are then too few for question 1, but a kind
   that is frequent on the other side is named.

Both kinds of test belong to the family of all tests of a page (`vispeg.evaluation.statistics.decide`), which gives the
verdicts.

With several networks, the network is the unit, because episodes of one network are not independent samples of a recipe.
Question 1 then compares each network's excess of a kind on the two sides: its count of the kind, minus the kind's share
of all failures times the network's number of failures (t test over networks, Bonferroni's correction over the kinds).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.stats import multivariate_hypergeom

from vispeg.evaluation.schema.gap import KindRow, PartingRecord
from vispeg.evaluation.statistics import CANNOT_TELL, Decision, Difference, Hypothesis, difference

MOST_TABLES = 20_000  # most tables with the given margins to enumerate; beyond, tables are drawn at random
Ends = Mapping[int, Mapping[Hashable, str]]  # training seed -> episode -> `success` or a category of failure


@dataclass(frozen=True)
class Kind:
    """How often one category of failure happened on two sides.

    Attributes:
        category: the category of failure.
        first, second: its share of the episodes on each side, 0 to 1.
        test: test that both shares are equal.
    """

    category: str
    first: float
    second: float
    test: Difference


@dataclass(frozen=True)
class Parting:
    """Failures by category on two sides.

    Attributes:
        first, second: counts of failures by category on each side.
        p: p-value of the hypothesis that both sides' failures have one distribution over categories; 1 where a side
            has no failure, as then there is only one table; None where no test can be made.
        where: the category whose share of the failures differs most (largest adjusted residual); "" where a side has
            no failure.
        residual: adjusted residual of that category, about standard normal if nothing differs; positive if it is more
            frequent on the second side.
        kinds: every category's share of the episodes, smallest p-value first.
        refused: why no test is made; "" if one is.
    """

    first: dict[str, int]
    second: dict[str, int]
    p: float | None
    where: str
    residual: float
    kinds: tuple[Kind, ...]
    refused: str = ""

    @property
    def tests(self) -> dict[str, Hypothesis | Difference]:
        """The tests by name: "" for the kinds of failures, and each category for its share of the episodes.

        Their weights add up to 1, because together they answer one question: how the failures differ.
        """
        weight = 1 / (1 + len(self.kinds))
        shares = {k.category: replace(k.test, weight=weight) for k in self.kinds}
        return {"": Hypothesis(self.p, weight), **shares}

    def decided(self, decisions: Mapping[str, Decision]) -> PartingRecord:
        """Return the record, as JSON data, with the page's decisions on `tests`."""
        rows: list[KindRow] = []
        for k in self.kinds:
            d = decisions[k.category]
            rows.append(
                {
                    "category": k.category,
                    "first": k.first,
                    "second": k.second,
                    "p": k.test.p,
                    "p_holm": 1.0 if d.p_holm is None else d.p_holm,
                    "verdict": ("more" if k.second > k.first else "fewer") if d.certain else CANNOT_TELL,
                }
            )
        return {
            "first": self.first,
            "second": self.second,
            "p": self.p,
            "where": self.where,
            "residual": self.residual,
            "verdict": decisions[""].verdict,
            "kinds": rows,
            "words": self._words(decisions[""].certain, rows),
        }

    def _words(self, differ: bool, kinds: Sequence[KindRow]) -> str:
        said = [
            f"{k['verdict']} {k['category']}: {100 * k['first']:.0f} to {100 * k['second']:.0f} % of the episodes"
            for k in kinds
            if k["verdict"] != CANNOT_TELL
        ]
        totals = [sum(side.values()) for side in (self.first, self.second)]
        if not sum(totals):
            said.append("no failure on either side")
        elif differ:
            more = f"{'more' if self.residual > 0 else 'fewer'} of them {self.where}"
            said.append(f"the kinds of failure differ, {more} ({self.residual:+.1f} standard deviations)")
        else:
            sides = " and ".join(map(str, totals))
            why = f": {self.refused}" if self.refused else ""
            said.append(f"whether the {sides} failures are of the same kinds, {CANNOT_TELL}{why}")
        return "; ".join(said)


def part(first: Ends, second: Ends, rng: np.random.Generator, draws: int = 4000) -> Parting:
    """Compare how the episodes of the same networks end on two sides.

    With one network, the test of kinds treats failures of the same seed on both sides as independent.

    Args:
        first, second: outcomes of each side; the same training seeds in both.
        rng: draws tables where there are too many to enumerate.
        draws: number of tables to draw; p is then (1 + hits) / (1 + draws), which is never 0.
    """
    ends = [[c for row in side.values() for c in row.values()] for side in (first, second)]
    sides = [Counter(c for c in side if c != "success") for side in ends]
    names = sorted(set(sides[0]) | set(sides[1]))
    counts = np.array([[side[name] for name in names] for side in sides], float).reshape(2, len(names))
    as_dicts = [{name: int(row[i]) for i, name in enumerate(names)} for row in counts]
    p: float | None = 1.0
    totals, where, residual, refused = counts.sum(axis=1), "", 0.0, ""
    if min(totals) > 0:
        columns = counts.sum(axis=0)
        expected = totals[:, None] * columns / totals.sum()
        share = columns / totals.sum()
        if len(first) == 1:
            p = _p_value(counts[0], columns, expected, rng, draws)
        else:
            p, refused = _over_networks(first, second, dict(zip(names, share, strict=True)))
        sd = np.sqrt(np.maximum(expected[1] * (1 - share) * totals[0] / totals.sum(), 1e-12))
        residuals = np.where(share < 1, (counts[1] - expected[1]) / sd, 0.0)
        worst = int(np.argmax(np.abs(residuals)))
        where, residual = names[worst], float(residuals[worst])
    n = [max(len(side), 1) for side in ends]
    kinds = [Kind(c, sides[0][c] / n[0], sides[1][c] / n[1], _shares(first, second, c)) for c in names]
    kinds.sort(key=lambda k: (1.0 if k.test.p is None else k.test.p, -abs(k.second - k.first)))
    return Parting(as_dicts[0], as_dicts[1], p, where, residual, tuple(kinds), refused)


def _shares(first: Ends, second: Ends, name: str, of_failures: float = 0.0) -> Difference:
    """Test whether a category's share of the episodes, minus `of_failures` times the failure rate, is the same."""
    sides = [
        {
            t: {episode: float(end == name) - of_failures * (end != "success") for episode, end in row.items()}
            for t, row in side.items()
        }
        for side in (first, second)
    ]
    found = difference(*sides, same_networks=True)
    return replace(found, discordant=None)  # so that `decide` computes no number of pairs, which `KindRow` lacks


def _over_networks(first: Ends, second: Ends, shares: Mapping[str, float]) -> tuple[float | None, str]:
    """Return the p-value of question 1 with several networks (see the module), or None and why there is none."""
    if len(shares) < 2:
        return 1.0, ""
    tests = [_shares(first, second, name, share) for name, share in shares.items()]
    found = [t.p for t in tests if t.p is not None]
    if not found:
        return None, tests[0].refused
    asked = 1 if len(shares) == 2 else len(shares)  # with two kinds, the two tests are the same
    return min(1.0, asked * min(found)), ""


def _p_value(
    first: np.ndarray, columns: np.ndarray, expected: np.ndarray, rng: np.random.Generator, draws: int
) -> float:
    """Return the probability, among tables with these margins, of a chi2 at least that of the row `first` (C,)."""
    n, statistic = int(first.sum()), _chi2(first[None], columns, expected)[0] - 1e-9
    if math.prod(int(c) + 1 for c in columns) <= MOST_TABLES:
        rows = np.array([r for r in product(*(range(int(c) + 1) for c in columns)) if sum(r) == n])
        chance = multivariate_hypergeom.pmf(rows, columns.astype(int), n)
        return float(min(1.0, chance[_chi2(rows, columns, expected) >= statistic].sum() / chance.sum()))
    drawn = rng.multivariate_hypergeometric(columns.astype(int), n, size=draws)  # (draws, C)
    return float((1 + np.sum(_chi2(drawn, columns, expected) >= statistic)) / (1 + draws))


def _chi2(first: np.ndarray, columns: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Return chi2 (m,) of tables given by their first row (m, C) and column sums (C,)."""
    second = columns - first
    return np.sum((first - expected[0]) ** 2 / expected[0] + (second - expected[1]) ** 2 / expected[1], axis=1)
