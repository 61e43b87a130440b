"""Whether two sets of failures are failures of the same kinds, which kinds are more frequent, and where they part.

Two questions. Of what kinds are the failures: Pearson's chi2 of the 2 x C table of failures, against all tables of the
same margins (the Freeman-Halton extension of Fisher's test, with chi2 for the order of tables; A. Agresti, Statistical
Science 7 (1992) 131). How often does each kind happen: the kind's share of all episodes, compared as success is. The
second answers also where one side hardly fails, as a simulation often does: there kinds of failures cannot be compared,
but a kind that appears elsewhere can be named. Both kinds of test belong to the family of all tests of a page
(`vispeg.evaluation.statistics.decide`), which gives the verdicts.

Of several networks the network is the unit of both, as of every comparison: episodes of one network are no independent
samples. The first question is then whether each network's excess of a kind, its count less the kind's share of all
failures times the network's failures, changes from one side to the other (t over networks, Bonferroni's correction over
the kinds).
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

MOST_TABLES = 20_000  # up to here all tables of the margins are listed, beyond they are drawn
Ends = Mapping[int, Mapping[Hashable, str]]  # training seed -> episode -> `success` or a category of failure


@dataclass(frozen=True)
class Kind:
    """How often one category of failure happened on two sides.

    Attributes:
        category: of the failure.
        first, second: share of the episodes, 0 to 1.
        test: that the shares are equal, as of success.
    """

    category: str
    first: float
    second: float
    test: Difference


@dataclass(frozen=True)
class Parting:
    """Failures by category on two sides.

    Attributes:
        first, second: counts by category, `success` left out.
        p: p-value that both sides' failures are drawn from one distribution over categories; 1 where a side has none,
            as then there is only one table; None where no test can be made.
        where: the category whose share of the failures differs most (largest adjusted residual); "" where a side has
            none.
        residual: its adjusted residual, about standard normal if nothing differed; > 0: more frequent in `second`.
        kinds: every category's share of the episodes, the surest difference first.
        refused: why no test is made; "" where one is.
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
        """The tests: "" of the kinds of failures, and one a category of its share of the episodes. They ask one thing,
        how failures differ, and share its weight.
        """
        weight = 1 / (1 + len(self.kinds))
        shares = {k.category: replace(k.test, weight=weight) for k in self.kinds}
        return {"": Hypothesis(self.p, weight), **shares}

    def decided(self, decisions: Mapping[str, Decision]) -> PartingRecord:
        """Give plain lists and dictionaries, with what the page's family decides on `tests`."""
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
            said.append(f"the failures are of other kinds, {more} ({self.residual:+.1f} standard deviations)")
        else:
            sides = " and ".join(map(str, totals))
            why = f": {self.refused}" if self.refused else ""
            said.append(f"whether the {sides} failures are of the same kinds, {CANNOT_TELL}{why}")
        return "; ".join(said)


def part(first: Ends, second: Ends, rng: np.random.Generator, draws: int = 4000) -> Parting:
    """Compare how the same networks end on two sides.

    Failures of one hard seed on both sides are taken for independent by the test of kinds of one network.

    Args:
        first, second: outcomes; the same training seeds in both.
        rng: draws tables where there are too many to list.
        draws: how many; p is then (1 + hits) / (1 + draws), so that it is never 0.
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
    return replace(found, discordant=None)  # no number of pairs is asked for


def _over_networks(first: Ends, second: Ends, shares: Mapping[str, float]) -> tuple[float | None, str]:
    """Return the p-value for equal categories of every network's failures on both sides, or why there is none."""
    if len(shares) < 2:
        return 1.0, ""
    tests = [_shares(first, second, name, share) for name, share in shares.items()]
    found = [t.p for t in tests if t.p is not None]
    if not found:
        return None, tests[0].refused
    asked = 1 if len(shares) == 2 else len(shares)  # of two kinds one's excess is the other's lack
    return min(1.0, asked * min(found)), ""


def _p_value(
    first: np.ndarray, columns: np.ndarray, expected: np.ndarray, rng: np.random.Generator, draws: int
) -> float:
    """Probability, among tables with these margins, of a chi2 as large as that of the row `first` (C,)."""
    n, statistic = int(first.sum()), _chi2(first[None], columns, expected)[0] - 1e-9
    if math.prod(int(c) + 1 for c in columns) <= MOST_TABLES:
        rows = np.array([r for r in product(*(range(int(c) + 1) for c in columns)) if sum(r) == n])
        chance = multivariate_hypergeom.pmf(rows, columns.astype(int), n)
        return float(min(1.0, chance[_chi2(rows, columns, expected) >= statistic].sum() / chance.sum()))
    drawn = rng.multivariate_hypergeometric(columns.astype(int), n, size=draws)  # (draws, C)
    return float((1 + np.sum(_chi2(drawn, columns, expected) >= statistic)) / (1 + draws))


def _chi2(first: np.ndarray, columns: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Chi2 (m,) of tables given by their first row (m, C) and column sums (C,)."""
    second = columns - first
    return np.sum((first - expected[0]) ** 2 / expected[0] + (second - expected[1]) ** 2 / expected[1], axis=1)
