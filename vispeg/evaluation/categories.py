"""Whether two sets of failures are failures of the same kinds, which kinds are more frequent, and where they part.

Two questions, two exact tests. Of what kinds are the failures: Pearson's chi2 of the 2 x C table of failures, against
all tables of the same margins (the Freeman-Halton extension of Fisher's test, with chi2 for the order of tables; A.
Agresti, Statistical Science 7 (1992) 131). How often does each kind happen: Fisher's test of the kind's share among
all episodes. The second answers also where one side hardly fails, as a simulation
often does: there kinds of failures cannot be compared, but a kind that appears elsewhere can be named. Both kinds of
test belong to the family of all tests of a page (`vispeg.evaluation.statistics.decide`), which gives the verdicts.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.stats import fisher_exact, multivariate_hypergeom

from vispeg.evaluation.schema.gap import KindRow, PartingRecord
from vispeg.evaluation.statistics import CANNOT_TELL, Decision, Hypothesis

MOST_TABLES = 20_000  # up to here all tables of the margins are listed, beyond they are drawn


@dataclass(frozen=True)
class Kind:
    """How often one category of failure happened on two sides.

    Attributes:
        category: of the failure.
        first, second: share of the episodes, 0 to 1.
        p: Fisher's exact test that the shares are equal.
    """

    category: str
    first: float
    second: float
    p: float


@dataclass(frozen=True)
class Parting:
    """Failures by category on two sides.

    Attributes:
        first, second: counts by category, `success` left out.
        p: exact p-value that both sides' failures are drawn from one distribution over categories; 1 where a side has
            none, as then there is only one table.
        where: the category whose share of the failures differs most (largest adjusted residual); "" where a side has
            none.
        residual: its adjusted residual, about standard normal if nothing differed; > 0: more frequent in `second`.
        kinds: every category's share of the episodes, the surest difference first.
    """

    first: dict[str, int]
    second: dict[str, int]
    p: float
    where: str
    residual: float
    kinds: tuple[Kind, ...]

    @property
    def tests(self) -> dict[str, Hypothesis]:
        """The tests: "" of the kinds of failures, and one a category of its share of the episodes. They ask one thing,
        how failures differ, and share its weight.
        """
        weight = 1 / (1 + len(self.kinds))
        return {"": Hypothesis(self.p, weight), **{k.category: Hypothesis(k.p, weight) for k in self.kinds}}

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
                    "p": k.p,
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
            said.append(f"whether the {sides} failures are of the same kinds, {CANNOT_TELL}")
        return "; ".join(said)


def part(first: Sequence[str], second: Sequence[str], rng: np.random.Generator, draws: int = 4000) -> Parting:
    """Compares two sequences of categories, one an episode, `success` among them.

    Failures of one hard seed on both sides are taken for independent.

    Args:
        first, second: outcomes.
        rng: draws tables where there are too many to list.
        draws: how many; p is then (1 + hits) / (1 + draws), so that it is never 0.
    """
    sides = [Counter(c for c in side if c != "success") for side in (first, second)]
    names = sorted(set(sides[0]) | set(sides[1]))
    counts = np.array([[side[name] for name in names] for side in sides], float).reshape(2, len(names))
    as_dicts = [{name: int(row[i]) for i, name in enumerate(names)} for row in counts]
    totals, p, where, residual = counts.sum(axis=1), 1.0, "", 0.0
    if min(totals) > 0:
        columns = counts.sum(axis=0)
        expected = totals[:, None] * columns / totals.sum()
        p = _p_value(counts[0], columns, expected, rng, draws)
        share = columns / totals.sum()
        sd = np.sqrt(np.maximum(expected[1] * (1 - share) * totals[0] / totals.sum(), 1e-12))
        residuals = np.where(share < 1, (counts[1] - expected[1]) / sd, 0.0)
        worst = int(np.argmax(np.abs(residuals)))
        where, residual = names[worst], float(residuals[worst])
    kinds = _kinds(names, counts, (len(first), len(second)))
    return Parting(as_dicts[0], as_dicts[1], p, where, residual, kinds)


def _kinds(names: Sequence[str], counts: np.ndarray, n: tuple[int, int]) -> tuple[Kind, ...]:
    """Fisher's test of every category's share of the (n) episodes of both sides, by p-value."""
    if min(n) < 1:
        return ()
    tables = [[[counts[j, i], n[j] - counts[j, i]] for j in (0, 1)] for i in range(len(names))]
    p = [min(1.0, float(fisher_exact(np.array(t, int))[1])) for t in tables]
    shares = [[float(counts[j, i] / n[j]) for j in (0, 1)] for i in range(len(names))]
    kinds = [Kind(name, here, there, p) for name, (here, there), p in zip(names, shares, p, strict=True)]
    return tuple(sorted(kinds, key=lambda k: (k.p, -abs(k.second - k.first))))


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
