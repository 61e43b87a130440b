"""Whether two sets of failures are failures of the same kinds, and where their distributions part."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

FEWEST = 5  # failures a side


@dataclass(frozen=True)
class Parting:
    """Failures by category on two sides.

    Attributes:
        first, second: counts by category, `success` left out.
        p: permutation p-value that both are drawn from one distribution over categories; None with fewer than 5
            failures on a side: these data cannot tell.
        where: the category whose share differs most (largest adjusted residual), None where p is None.
        residual: its adjusted residual, about standard normal if nothing differed; > 0: more frequent in `second`.
    """

    first: dict[str, int]
    second: dict[str, int]
    p: float | None
    where: str | None
    residual: float | None


def part(first: Sequence[str], second: Sequence[str], rng: np.random.Generator, draws: int = 4000) -> Parting:
    """Compares the failures among two sequences of categories (`success` is ignored).

    Pearson's chi2 of the 2 x C table, its p-value from tables with the same margins: labels shuffled among all
    failures. (1 + hits) / (1 + draws), so that p is never 0. Failures of one hard seed on both sides are taken for
    independent.
    """
    sides = [Counter(c for c in side if c != "success") for side in (first, second)]
    names = sorted(set(sides[0]) | set(sides[1]))
    counts = np.array([[side[name] for name in names] for side in sides], float).reshape(2, len(names))
    as_dicts = [{name: int(row[i]) for i, name in enumerate(names)} for row in counts]
    totals = counts.sum(axis=1)
    if min(totals) < FEWEST:
        return Parting(as_dicts[0], as_dicts[1], p=None, where=None, residual=None)
    columns = counts.sum(axis=0)
    expected = totals[:, None] * columns / totals.sum()
    drawn = rng.multivariate_hypergeometric(columns.astype(int), int(totals[0]), size=draws)  # (draws, C)
    hits = np.sum(_chi2(drawn, columns, expected) >= _chi2(counts[:1], columns, expected)[0] - 1e-9)
    share = columns / totals.sum()
    sd = np.sqrt(np.maximum(expected[1] * (1 - share) * totals[0] / totals.sum(), 1e-12))
    residual = np.where(share < 1, (counts[1] - expected[1]) / sd, 0.0)
    worst = int(np.argmax(np.abs(residual)))
    return Parting(as_dicts[0], as_dicts[1], (1 + hits) / (1 + draws), names[worst], float(residual[worst]))


def _chi2(first: np.ndarray, columns: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Chi2 (m,) of tables given by their first row (m, C) and column sums (C,)."""
    second = columns - first
    return np.sum((first - expected[0]) ** 2 / expected[0] + (second - expected[1]) ** 2 / expected[1], axis=1)
