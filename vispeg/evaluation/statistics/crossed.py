"""Intervals over training seeds and episodes at once: what a recipe does, not what one trained network did.

Outcomes stand in matrices Y (training seeds k, episodes n). Training seeds and episodes are both samples, crossed. A
mean, a gap between worlds, a main effect or an interaction is a sum over blocks of weighted matrix means; its
variance has a part from the episodes, which all blocks share, and one from the training seeds of each block:

    var = S^2(column contrast) / n  +  sum over policies of max(0, MS_seed - MS_rest) / (n k)

from the two-way analysis of variance without replication (S. R. Searle, G. Casella, C. E. McCulloch, Variance
Components, 1992, ch. 4). Where training seeds differ at all, the t quantile has the degrees of freedom of their part
alone (Welch-Satterthwaite over policies, Biometrics Bulletin 2 (1946) 110): two, with three training seeds of one
policy. Weighting in the episodes' many degrees of freedom, as Satterthwaite would, covered 86-92 % in simulation
instead of 90-98 %; the pooled Wilson interval, which takes three networks' episodes for independent, as little as 26
%. A bootstrap over training seeds (`crossed_bootstrap`) covered 78-99 % with three seeds; it is kept for statistics
that are not linear.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from vispeg.core.errors import UserError
from vispeg.evaluation.statistics.intervals import LEVEL, Estimate, Z, paired_difference, wilson


@dataclass(frozen=True)
class Block:
    """One policy's share in a contrast.

    Attributes:
        values: (k, n) a number an episode: a success, or already a weighted sum over worlds of one network's successes.
            All blocks have the same episodes as columns.
    """

    values: np.ndarray

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or 0 in self.values.shape:
            raise UserError("not a matrix of outcomes", expected="(training seeds, episodes)", got=self.values.shape)


def spread(blocks: Sequence[Block]) -> tuple[float, float, float]:
    """The sum of the blocks' means, its variance, and the variance's degrees of freedom (inf where it is 0)."""
    n = blocks[0].values.shape[1]
    if any(block.values.shape[1] != n for block in blocks):
        raise UserError("blocks of different episodes", got=[block.values.shape[1] for block in blocks])
    columns = np.sum([block.values.mean(axis=0) for block in blocks], axis=0)  # (n,)
    within = float(columns.var(ddof=1)) / n if n > 1 else 0.0
    between = []  # (variance, degrees of freedom) a block
    for block in blocks:
        k = len(block.values)
        if k > 1 and n > 1:
            rows = block.values.mean(axis=1)  # (k,)
            rest = block.values - rows[:, None] - block.values.mean(axis=0) + block.values.mean()
            excess = n * rows.var(ddof=1) - np.sum(rest**2) / ((k - 1) * (n - 1))
            between.append((max(0.0, float(excess)) / (n * k), k - 1))
    seeds, below = sum(v for v, _ in between), sum(v * v / df for v, df in between)
    df = seeds**2 / below if below > 0 else float(n - 1) if within > 0 else math.inf
    return float(columns.mean()), within + seeds, df


def rate(outcomes: np.ndarray) -> Estimate:
    """The success rate of a recipe from (k, n) outcomes.

    One training seed: Wilson's interval. Several: Wilson's form with the effective number of episodes p (1 - p) / var
    and the t quantile; where all succeed or all fail, the n episodes count once, however many networks ran them.
    """
    outcomes = np.atleast_2d(np.asarray(outcomes, float))
    k, n = outcomes.shape
    p, variance, df = spread([Block(outcomes)])
    if k == 1 or variance <= 0:
        return Estimate(p, *_bounds(wilson(round(p * n), n)), k * n)
    quantile = float(student.ppf(0.5 + LEVEL / 2, df))
    effective = max(p * (1 - p) / variance, 1.0)
    middle = (p + quantile**2 / (2 * effective)) / (1 + quantile**2 / effective)
    half = quantile / (1 + quantile**2 / effective)
    half *= math.sqrt(p * (1 - p) / effective + quantile**2 / (4 * effective**2))
    return Estimate(p, max(0.0, middle - half), min(1.0, middle + half), k * n)


def contrast(blocks: Sequence[Block], limit: float = 1.0, pairs: int | None = None) -> Estimate:
    """The sum of the blocks' means with a t interval, never narrower than Z^2 / (n + Z^2), Tango's at no discordance.

    Args:
        blocks: signed, weighted values a policy.
        limit: the largest value that the contrast can take.
        pairs: n, where a column is the mean of several pairs.
    """
    value, variance, df = spread(blocks)
    n = pairs or blocks[0].values.shape[1]
    quantile = float(student.ppf(0.5 + LEVEL / 2, df)) if math.isfinite(df) else Z
    half = max(quantile * math.sqrt(variance), Z**2 / (n + Z**2))
    return Estimate(value, max(-limit, value - half), min(limit, value + half), n)


def difference(first: np.ndarray, second: np.ndarray, same_networks: bool) -> Estimate:
    """Mean of `first` minus mean of `second`, (k, n) outcomes of the same episodes.

    Args:
        first, second: outcomes; with one training seed each, Tango's interval is used.
        same_networks: whether row i of both is the same network (one policy in two worlds), so that it is a pair.
    """
    first, second = np.atleast_2d(np.asarray(first, float)), np.atleast_2d(np.asarray(second, float))
    if len(first) == len(second) == 1:
        return paired_difference(first[0] > 0.5, second[0] > 0.5)
    return contrast([Block(first - second)] if same_networks else [Block(first), Block(-second)])


def crossed_bootstrap(
    statistic: Callable[[list[np.ndarray]], float],
    blocks: Sequence[np.ndarray],
    rng: np.random.Generator,
    draws: int = 2000,
) -> Estimate:
    """Percentile interval of any statistic, resampling training seeds (of each block) and episodes (of all at once).

    Args:
        statistic: of a list of (k, n) matrices.
        blocks: (k, n) outcomes a policy, the same episodes as columns.
        rng: the random generator.
        draws: resamples.
    """
    n = blocks[0].shape[1]
    values = np.empty(draws)
    for i in range(draws):
        columns = rng.integers(n, size=n)
        values[i] = statistic([b[rng.integers(len(b), size=len(b))][:, columns] for b in blocks])
    low, high = np.nanquantile(values, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    return Estimate(float(statistic(list(blocks))), float(low), float(high), n)


def _bounds(e: Estimate) -> tuple[float, float]:
    return e.low, e.high
