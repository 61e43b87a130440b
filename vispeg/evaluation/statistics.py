"""Statistics of success: every interval, test and verdict on a page, in the order in which the page is made.

1. **A rate.** With one network: Wilson's score interval (E. B. Wilson, JASA 22 (1927) 209). With several: Wilson's form
   with the variance of section 3.
2. **A difference between two sides.** With one network per side and the same episodes on both: McNemar's exact test,
   the binomial test on the discordant pairs (Q. McNemar, Psychometrika 12 (1947) 153), with Tango's score interval (T.
   Tango, Statistics in Medicine 17 (1998) 891). With different episodes, as in a robot's trials: Fisher's exact test
   with Newcombe's interval (R. G. Newcombe, Statistics in Medicine 17 (1998) 873, method 10). These results hold for
   the networks that were played.
3. **Several training seeds.** The network is the unit, because episodes of one network are not independent samples of a
   recipe. With outcomes y (networks k, episodes n), the variance of a mean has a part due to the networks and a part
   due to the episodes that all networks share, from the two-way analysis of variance without replication (S. R. Searle,
   G. Casella, C. E. McCulloch, Variance Components, 1992, ch. 4):

       V = sum over sides of var(row means) / k  +  max(0, var(column contrast) - sum of MS_rest / k) / n

   Each part has its own t quantile, with Satterthwaite's degrees of freedom over sides (F. E. Satterthwaite, Biometrics
   Bulletin 2 (1946) 110). The two half-widths are added in quadrature. In simulated data, 93 to 98 % of these intervals
   cover the truth. With fewer than three networks no statement on a recipe is made (`FEWEST_NETWORKS`), because the
   spread of two is known only to a factor of 32 (chi-squared, one degree of freedom, 95 %).
4. **All comparisons of a page are one family.** `decide` adjusts their p-values together by Holm's procedure (S. Holm,
   Scandinavian Journal of Statistics 6 (1979) 65). So of pages on which nothing differs, at most 5 % call anything
   different. Verdicts, words and intervals follow from the adjusted p-value: the interval of a difference is taken at
   the level that Holm's step leaves for its comparison, and excludes 0 exactly where the verdict is *different*.
5. **How many pairs are needed** follows from the exact power of McNemar's test at the level of Holm's first step.
6. **Which factor costs what**: a part's share of a loss is a ratio, and its interval is Fieller's (E. C. Fieller, JRSS
   B 16 (1954) 175).
7. **Whether one world predicts the other**: the correlation of the true rates over policies or configurations, with the
   noise of each rate known from its episodes (bivariate random effects: H. C. van Houwelingen, L. R. Arends, T.
   Stijnen, Statistics in Medicine 21 (2002) 589), and its profile-likelihood interval. If the rates vary no more than
   the noise does, the likelihood is flat and the interval is -1 to 1. The correlation of the measured rates cannot be
   expected to exceed a *ceiling* that the number of episodes sets, so it is never stated without that.
8. **What the simulator is worth in real trials**: as a control variate it leaves 1 - rho^2 of the variance of the
   robot's rate. So n trials paired with simulation tell as much as n / (1 - rho^2) trials alone (S. S. Lavenberg, P. D.
   Welch, Management Science 27 (1981) 322).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, TypeVar

import numpy as np
from scipy.optimize import brentq
from scipy.special import stdtr, stdtrit
from scipy.stats import binom, binomtest, chi2, fisher_exact, mannwhitneyu, norm

from vispeg.core.errors import UserError
from vispeg.core.holm import holm
from vispeg.evaluation.schema.estimate import Interval

ALPHA = 0.05  # error rate of a whole page
POWER = 0.8
LEVEL = 1 - ALPHA
MARGIN = 0.05  # difference of success within which two rates are called equal
FEWEST_NETWORKS = 3
FEWEST_PAIRED = 20  # trials; with fewer that all agree, the interval of their correlation covers too little
BUYS = 0.2  # a simulator that is worth fewer further trials than this share of those made is called worthless
FEWEST_POLICIES = 8  # with fewer, the interval of a correlation of 0.7 reaches 0
CANNOT_TELL = "these data cannot tell"
RULE = (
    "All comparisons of this page are one family: two success rates are called different if the p-value after Holm's "
    "correction over all of them is below 5 %. So of pages on which nothing differs, at most 5 % call anything "
    "different. Two rates are called equal if the interval of their difference lies within 5 points either way. "
    "Otherwise these data cannot tell. The intervals of differences are widened to the level that Holm's correction "
    "leaves for them, and exclude 0 exactly where the verdict is different. With one network per side the tests are "
    "exact (McNemar's on the same episodes, Fisher's on different ones) and hold for these networks only. With several "
    "networks per side, the network is the unit (t test), and at least three are needed."
)
Verdict = Literal["different", "equal", "these data cannot tell"]
Rows = Mapping[int, Mapping[Hashable, float]]  # training seed -> episode -> outcome (0 or 1, or a mean of such)
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True)
class Estimate:
    """A number with its interval.

    Attributes:
        value: the point estimate.
        low, high: ends of the interval, 95 % unless stated otherwise.
        n: number of episodes behind it; of pairs, for a paired difference.
    """

    value: float
    low: float
    high: float
    n: int

    def excludes(self, value: float = 0.0) -> bool:
        """Return whether `value` lies outside the interval."""
        return value < self.low or value > self.high

    def to_json(self) -> Interval:
        """Return {value, low, high, n}, with null for numbers that are not finite."""
        value, low, high = (float(v) if math.isfinite(v) else None for v in (self.value, self.low, self.high))
        return {"value": value, "low": low, "high": high, "n": self.n}


# 1. A rate


def wilson(successes: int, n: int, alpha: float = ALPHA) -> Estimate:
    """Return a proportion with Wilson's score interval at level 1 - alpha.

    Raises:
        UserError: no trial, or more successes than trials.
    """
    if n < 1 or not 0 <= successes <= n:
        raise UserError("not a count of successes", expected="0 <= successes <= n, n >= 1", got=f"{successes} of {n}")
    p, z = successes / n, float(norm.ppf(1 - alpha / 2))
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low = 0.0 if successes == 0 else middle - half
    return Estimate(p, low, 1.0 if successes == n else middle + half, n)


def rate(rows: Rows) -> Estimate:
    """Return the success rate, the mean of the networks' rates over all of their episodes, with its interval.

    With several networks the interval has Wilson's form with p (1 - p) / V effective episodes and the t quantile. If
    all episodes succeed or all fail, each episode counts once, however many networks played it.

    Raises:
        UserError: no episodes.
    """
    networks = [np.array(list(row.values()), float) for row in rows.values() if row]
    if not networks:
        raise UserError("no episodes")
    n, most = sum(map(len, networks)), max(map(len, networks))
    if len(networks) == 1:
        return wilson(round(float(networks[0].sum())), n)
    side = _side(rows, _shared(rows) if min(map(len, networks)) == most else [])
    moments = _moments([side], paired=True)
    p = moments.value
    if p in (0.0, 1.0):
        return replace(wilson(round(p * most), most), n=n)
    quantile = moments.half(ALPHA) / math.sqrt(moments.variance)  # one t quantile for both parts of the variance
    effective = max(p * (1 - p) / moments.variance, 1.0)
    middle = (p + quantile**2 / (2 * effective)) / (1 + quantile**2 / effective)
    half = quantile / (1 + quantile**2 / effective)
    half *= math.sqrt(p * (1 - p) / effective + quantile**2 / (4 * effective**2))
    return Estimate(p, max(0.0, middle - half), min(1.0, middle + half), n)


def rate_words(rate: Estimate, successes: int) -> str:
    """Return successes, and the interval of the rate, in words: `4 of 4: 51 to 100 %`."""
    return f"{successes} of {rate.n}: {100 * rate.low:.0f} to {100 * rate.high:.0f} %"


def episodes_needed(rate: Estimate) -> int | None:
    """Return the number of episodes that would give one network's rate to within the margin; None if these do.

    It is Wald's number for a half-width equal to the margin, at the rate in the interval that needs most episodes.
    """
    if max(rate.high - rate.value, rate.value - rate.low) <= MARGIN:
        return None
    p = min(max(rate.low, 0.5), rate.high)
    return math.ceil(float(norm.ppf(1 - ALPHA / 2)) ** 2 * p * (1 - p) / MARGIN**2)


# 2. A difference between two sides


@dataclass(frozen=True)
class Hypothesis:
    """A hypothesis that a page tests.

    Attributes:
        p: its p-value before adjustment; None where no test can be made.
        weight: its relative share of the page's 5 %; hypotheses that answer one question together share a weight of 1.
    """

    p: float | None
    weight: float = 1.0


@dataclass(frozen=True)
class Difference:
    """Success on one side minus success on the other, with the test of whether it is 0.

    Attributes:
        p, weight: as in Hypothesis.
        value: the difference, -1 to 1.
        interval: function of alpha that returns the ends of the 1 - alpha interval.
        n: number of pairs, or of episodes on the smaller side if they do not pair.
        networks: number of networks on the side with fewer; 1 if the result holds for the networks played only.
        paired: whether both sides played the same episodes.
        discordant: share of pairs that end differently; None where the unit is not a pair of episodes.
        refused: why no statement is made; "" if one is.
    """

    p: float | None
    value: float
    interval: Callable[[float], tuple[float, float]]
    n: int
    networks: int = 1
    paired: bool = True
    discordant: float | None = None
    refused: str = ""
    weight: float = 1.0


def difference(
    first: Rows, second: Rows, same_networks: bool, trained: tuple[bool, bool] = (True, True), each: int = 1
) -> Difference:
    """Compare success on two sides.

    Episodes are paired if all networks of both sides played the episodes of the network that played fewest. Otherwise
    the sides are independent samples.

    Args:
        first, second: outcomes of each side.
        same_networks: whether a training seed is the same network on both sides (one policy in two worlds); networks
            that played one side only are then left out.
        trained: for each side, whether its networks are samples of a training recipe; False for a scripted policy.
        each: number of outcomes behind every number, where numbers are means.
    """
    if same_networks:
        common = [t for t in first if t in second]
        first, second = ({t: side[t] for t in common} for side in (first, second))
    if not first or not second:
        refused = "no network was played on both sides" if same_networks else "no episodes"
        return Difference(None, math.nan, lambda alpha: (-1.0, 1.0), 0, 0, False, None, refused)
    shared = _shared({(side, t): row for side, rows in enumerate((first, second)) for t, row in rows.items()})
    sides = [_side(rows, shared or _shared(rows)) for rows in (first, second)]
    return _compared(sides[0], sides[1], same_networks, bool(shared), trained, each)


def contrast(*blocks: np.ndarray) -> Difference:
    """Test whether the sum of the blocks' means is 0.

    Args:
        blocks: signed values (networks, episodes) of one policy each, such as weighted sums over worlds; column j is
            the same episode in all blocks.
    """
    sides = [_Side(list(np.atleast_2d(np.asarray(block, float))), True) for block in blocks]
    return _by_t(sides, True, min(len(side.rows) for side in sides), len(sides[0].rows[0]), limit=math.inf)


@dataclass(frozen=True)
class _Side:
    """Outcomes of a side.

    Attributes:
        rows: one array of outcomes per network.
        crossed: whether entry j is the same episode for all networks.
    """

    rows: list[np.ndarray]
    crossed: bool

    @property
    def means(self) -> np.ndarray:
        return np.array([row.mean() for row in self.rows])

    def __neg__(self) -> _Side:
        return _Side([-row for row in self.rows], self.crossed)


def _shared(rows: Mapping[Any, Mapping[Hashable, float]]) -> list[Hashable]:
    """Return the episodes that all networks played, if these are all episodes of the network that played fewest.

    Otherwise return none, so that a few episodes in common by chance do not stand for all of them.
    """
    shared = set.intersection(*(set(row) for row in rows.values()))
    return sorted(shared, key=repr) if len(shared) == min(map(len, rows.values())) else []


def _side(rows: Rows, episodes: Sequence[Hashable]) -> _Side:
    """Return the outcomes of these episodes for every network; without episodes in common, all outcomes of each."""
    if episodes:
        return _Side([np.array([rows[t][e] for e in episodes], float) for t in sorted(rows)], True)
    return _Side([np.array(list(rows[t].values()), float) for t in sorted(rows)], False)


def _compared(
    first: _Side, second: _Side, same: bool, paired: bool, trained: tuple[bool, bool], each: int
) -> Difference:
    """Compare two sides by an exact test if each has one network with outcomes 0 or 1, else by a t test.

    Args:
        first, second: the sides.
        same: whether row i is the same network on both sides.
        paired: whether both sides played the same episodes.
        trained, each: as in `difference`.
    """
    counts = [len(first.rows), len(second.rows)]
    n = min(sum(map(len, side.rows)) if not side.crossed else len(side.rows[0]) for side in (first, second))
    if counts == [1, 1]:
        values = np.concatenate([first.rows[0], second.rows[0]])
        if np.isin(values, (0.0, 1.0)).all():
            return (_by_mcnemar if paired else _by_fisher)(first.rows[0] > 0.5, second.rows[0] > 0.5)
    sampled = [k for k, varies in zip(counts, trained, strict=True) if varies or k > 1]  # sides that sample a recipe
    if not same and min(sampled, default=1) == 1 < max(sampled, default=1):  # one network against several
        refused = f"{counts[0]} and {counts[1]} training seeds, of a recipe {FEWEST_NETWORKS} or more are needed"
        value = float(first.means.mean() - second.means.mean())
        return Difference(None, value, lambda alpha: (-1.0, 1.0), n, min(sampled), paired, None, refused)
    if paired and same:
        blocks = [_Side([a - b for a, b in zip(first.rows, second.rows, strict=True)], True)]
    else:
        blocks = [first, -second]
    return _by_t(blocks, paired, min(sampled, default=1), n, same and not paired, each)


def _by_t(
    blocks: Sequence[_Side],
    paired: bool,
    networks: int,
    n: int,
    same_networks: bool = False,
    each: int = 1,
    limit: float = 1.0,
) -> Difference:
    """Test by t whether the sum of the blocks' means is 0.

    Args:
        blocks, same_networks, each: as in `_moments`.
        paired, networks, n: as in `Difference`.
        limit: largest possible absolute value of the sum.
    """
    moments = _moments(blocks, paired, same_networks, each)
    value = moments.value

    def interval(alpha: float) -> tuple[float, float]:
        half = moments.half(alpha)
        return max(-limit, value - half), min(limit, value + half)

    refused = ""
    if 1 < networks < FEWEST_NETWORKS:
        refused = f"{networks} training seeds, of a recipe {FEWEST_NETWORKS} or more are needed"
    return Difference(None if refused else _p_of(interval), value, interval, n, networks, paired, None, refused)


def fall(configurations: Sequence[tuple[Rows, Rows]]) -> Difference:
    """Compare one policy's success on two sides, the mean difference over the configurations of a suite.

    If both sides played the same seeds, the outcome of a seed is its mean over configurations, so that a seed that is
    hard in every configuration counts once. If not, as with a robot's trials, one network's Newcombe intervals of the
    configurations are combined by the squares of their half-widths (G. Y. Zou, A. Donner, Statistics in Medicine 27
    (2008) 1693); of several networks, their differences are the sample.

    Args:
        configurations: outcomes on the first and on the second side, for each configuration.
    """
    sides = [_averaged([both[side] for both in configurations]) for side in (0, 1)]
    if all(sides) and _shared({(side, t): row for side, rows in enumerate(sides) for t, row in rows.items()}):
        return difference(*sides, same_networks=True, each=len(configurations))
    networks = [t for t in configurations[0][0] if all(t in rows for both in configurations for rows in both)]
    if len(networks) != 1:
        return difference(*(_weighted([c[i] for c in configurations], networks) for i in (0, 1)), same_networks=True)
    counts = [  # for each configuration, (successes, trials) on both sides
        [(round(sum(rows[networks[0]].values())), len(rows[networks[0]])) for rows in both] for both in configurations
    ]
    values = [a / m - b / n for (a, m), (b, n) in counts]
    value, episodes = float(np.mean(values)), sum(min(m, n) for (_, m), (_, n) in counts)

    def interval(alpha: float) -> tuple[float, float]:
        ends = [newcombe((a, b), (m, n), alpha) for (a, m), (b, n) in counts]
        low, high = (math.hypot(*(v - e[i] for v, e in zip(values, ends, strict=True))) / len(ends) for i in (0, 1))
        return max(-1.0, value - low), min(1.0, value + high)

    return Difference(_p_of(interval), value, interval, episodes, 1, False)


def _averaged(configurations: Sequence[Rows]) -> dict[int, dict[Hashable, float]]:
    """Return training seed -> seed -> mean over configurations, for the seeds that all configurations have."""
    networks = [t for t in configurations[0] if all(t in rows for rows in configurations)]
    of = {t: [rows[t] for rows in configurations] for t in networks}
    seeds = {t: set.intersection(*map(set, rows)) for t, rows in of.items()}
    return {t: {s: float(np.mean([row[s] for row in of[t]])) for s in seeds[t]} for t in networks if seeds[t]}


def _weighted(configurations: Sequence[Rows], networks: Sequence[int]) -> dict[int, dict[Hashable, float]]:
    """Return every trial by itself, weighted so that a network's mean is the mean of its configurations' rates."""
    rows: dict[int, dict[Hashable, float]] = {}
    for t in networks:
        total = sum(len(c[t]) for c in configurations)
        each = [(len(c[t]), y) for c in configurations for y in c[t].values()]
        rows[t] = {(t, i): y * total / (n * len(configurations)) for i, (n, y) in enumerate(each)}
    return rows


def _p_of(interval: Callable[[float], tuple[float, float]]) -> float:
    """Return the p-value that belongs to an interval: the alpha at which one of its ends is 0, at least 1e-15."""

    def distance(exponent: float) -> float:
        low, high = interval(10.0**exponent)
        return max(low, -high)

    if distance(0.0) <= 0:
        return 1.0
    return float(10 ** brentq(distance, -15.0, 0.0, xtol=1e-6)) if distance(-15.0) < 0 else 1e-15


def by_ranks(first: Rows, second: Rows) -> float | None:
    """Return the p-value of the hypothesis that a time or force is larger on one side as often as on the other.

    With one network it is the Mann-Whitney test's. With several, it is that of a t test over networks on each one's
    share of pairs in which the first value is larger; the variance of a share is at least that of equal distributions.
    None with two networks, or with none on both sides.

    Args:
        first, second: one value per episode; networks without values on one side are left out.
    """
    networks = [t for t in first if t in second]
    sides = [[np.array(list(side[t].values()), float) for side in (first, second)] for t in networks]
    if len(sides) == 1:
        return float(mannwhitneyu(*sides[0]).pvalue)
    if len(sides) < FEWEST_NETWORKS:
        return None
    shares = np.array([mannwhitneyu(x, y).statistic / (len(x) * len(y)) for x, y in sides])
    least = float(np.mean([(len(x) + len(y) + 1) / (12 * len(x) * len(y)) for x, y in sides]))
    variance = max(float(shares.var(ddof=1)), least) / len(shares)
    return float(2 * stdtr(len(shares) - 1, -abs(float(shares.mean()) - 0.5) / math.sqrt(variance)))


# 3. Several training seeds


@dataclass(frozen=True)
class _Moments:
    """A sum of means, and the parts of its variance due to networks and to episodes, with their degrees of freedom."""

    value: float
    networks: float
    df_networks: float
    episodes: float
    df_episodes: float

    @property
    def variance(self) -> float:
        return self.networks + self.episodes

    def half(self, alpha: float) -> float:
        """Return half the width of the 1 - alpha interval: both parts' half-widths, added in quadrature."""
        parts = (self.networks, self.df_networks), (self.episodes, self.df_episodes)
        return math.sqrt(sum(v * float(stdtrit(df, alpha / 2)) ** 2 for v, df in parts if v > 0))


def _moments(blocks: Sequence[_Side], paired: bool, same_networks: bool = False, each: int = 1) -> _Moments:
    """Return the sum of the blocks' means and the parts of its variance V.

    Args:
        blocks: signed outcomes, one block per side.
        paired: whether entry j is the same episode in all blocks.
        same_networks: whether row i is the same network in all blocks.
        each: as in `difference`.
    """
    value = float(sum(block.means.mean() for block in blocks))
    rows = [np.sum([b.means for b in blocks], axis=0)] if same_networks else [b.means for b in blocks]
    least = _least(each * min(len(row) for block in blocks for row in block.rows))
    networks = [(max(float(m.var(ddof=1)), least) / len(m), len(m) - 1) for m in rows if len(m) > 1]
    episodes = []
    for group in [blocks] if paired else [[block] for block in blocks]:
        n = len(group[0].rows[0])
        if n > 1 and all(block.crossed for block in group):
            columns = np.sum([np.mean(block.rows, axis=0) for block in group], axis=0)  # (n,)
            residual = sum(_residual(np.array(block.rows)) / len(block.rows) for block in group if len(block.rows) > 1)
            excess = max(0.0, float(columns.var(ddof=1)) - residual) / n
            single = all(len(block.rows) == 1 for block in group)
            episodes.append((max(excess, _least(each * n)) if single else excess, n - 1))
    if not networks and not episodes:  # a single episode
        return _Moments(value, 0.0, 1.0, 1.0, 1.0)
    return _Moments(value, *_satterthwaite(networks), *_satterthwaite(episodes))


def _satterthwaite(parts: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the sum of variances and its degrees of freedom, for pairs of both, by Satterthwaite's formula."""
    total = sum(v for v, _ in parts)
    divisor = sum(v * v / df for v, df in parts)
    return total, total**2 / divisor if divisor > 0 else 1.0


def _residual(y: np.ndarray) -> float:
    """Return MS_rest, the mean square of y (k, n) after row and column means are removed."""
    k, n = y.shape
    residual = y - y.mean(axis=1, keepdims=True) - y.mean(axis=0) + y.mean()
    return float(np.sum(residual**2)) / ((k - 1) * (n - 1))


def _least(n: int) -> float:
    """Return the variance of a mean of n identical outcomes, as in Tango's interval without discordant pairs."""
    z = float(norm.ppf(1 - ALPHA / 2))
    return (z / (n + z * z)) ** 2


# One network a side: exact tests


def mcnemar(first_only: int, second_only: int) -> float:
    """Return McNemar's two-sided exact p-value for equal paired rates, from the counts of discordant pairs."""
    pairs = first_only + second_only
    return float(binomtest(first_only, pairs).pvalue) if pairs else 1.0


def _by_mcnemar(first: np.ndarray, second: np.ndarray) -> Difference:
    """Compare successes (n,) bool of one network per side on the same episodes."""
    b, c, n = int(np.sum(first & ~second)), int(np.sum(~first & second)), len(first)
    return Difference(mcnemar(b, c), (b - c) / n, lambda alpha: tango(b, c, n, alpha), n, 1, True, (b + c) / n)


def _by_fisher(first: np.ndarray, second: np.ndarray) -> Difference:
    """Compare successes, (m,) and (n,) bool, of one network per side on different episodes."""
    (a, m), (b, n) = ((int(side.sum()), len(side)) for side in (first, second))
    p = float(fisher_exact([[a, m - a], [b, n - b]]).pvalue)
    return Difference(min(1.0, p), a / m - b / n, lambda alpha: newcombe((a, b), (m, n), alpha), min(m, n), 1, False)


def newcombe(successes: tuple[int, int], trials: tuple[int, int], alpha: float = ALPHA) -> tuple[float, float]:
    """Return the interval of p1 - p2 of independent samples from their two Wilson intervals (method 10)."""
    p1, p2 = (wilson(s, n, alpha) for s, n in zip(successes, trials, strict=True))
    value = p1.value - p2.value
    return (
        value - math.hypot(p1.value - p1.low, p2.high - p2.value),
        value + math.hypot(p1.high - p1.value, p2.value - p2.low),
    )


def tango(b: int, c: int, n: int, alpha: float = ALPHA) -> tuple[float, float]:
    """Return the interval of p1 - p2 that the score test accepts (`tango_score`), for b and c discordant pairs of n."""
    value, z = (b - c) / n, float(norm.ppf(1 - alpha / 2))
    return _root(b, c, n, -1.0, value, +z), _root(b, c, n, value, 1.0, -z)


def tango_score(b: int, c: int, n: int, delta: float) -> float:
    """Return the score statistic (standard normal under p1 - p2 = delta), for b and c discordant pairs of n.

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


def _root(b: int, c: int, n: int, low: float, high: float, target: float) -> float:
    """Return the delta from `low` to `high` at which the score, which falls with delta, comes nearest to `target`."""
    eps = 1e-12
    low, high = low + eps, high - eps

    def excess(delta: float) -> float:
        score = tango_score(b, c, n, delta)
        return max(min(score, 1e6), -1e6) - target

    if low >= high or excess(low) <= 0:
        return low
    return high if excess(high) >= 0 else float(brentq(excess, low, high, xtol=1e-10))


# 4. All comparisons of a page


@dataclass(frozen=True)
class Decision:
    """Result of one test of a page, adjusted for the others.

    Attributes:
        test: the test.
        p_holm: its p-value adjusted over the family; None where no test could be made.
        verdict: the verdict.
        family: number of tests in the family.
        estimate: for a difference, its value and interval; the interval excludes 0 exactly where the verdict is
            `different`.
        needed: number of pairs that would detect a difference as large as the margin with 80 % power at Holm's first
            step, if the verdict is that these data cannot tell; None where the test has as many, or where the unit
            is not a pair of episodes.
    """

    test: Hypothesis | Difference
    p_holm: float | None
    verdict: Verdict
    family: int
    estimate: Estimate = Estimate(math.nan, math.nan, math.nan, 0)
    needed: int | None = None

    @property
    def certain(self) -> bool:
        """Whether the two sides are called different."""
        return self.verdict == "different"

    @property
    def paired(self) -> bool:
        """Whether both sides played the same episodes."""
        return isinstance(self.test, Difference) and self.test.paired

    @property
    def refused(self) -> str:
        """Why no statement is made; "" if one is."""
        return self.test.refused if isinstance(self.test, Difference) else ""


def decide(tests: Mapping[Key, Hypothesis | Difference], margin: float = MARGIN) -> dict[Key, Decision]:
    """Decide all tests of a page together, by Holm's procedure.

    Args:
        tests: the tests by key; those with p None are not in the family and get the verdict that data cannot tell.
        margin: difference of success within which two rates are called equal.
    """
    asked = {key: (test.p, test.weight) for key, test in tests.items() if test.p is not None}
    adjusted = dict(zip(asked, holm(*zip(*asked.values(), strict=True)), strict=True)) if asked else {}
    total = sum(weight for _, weight in asked.values())
    # total weight by which Holm's procedure divides ALPHA for each test: for a rejected test, that of the tests not
    # rejected before it; for any other, that of all tests not rejected
    divisor = {
        key: sum(w for other, (_, w) in asked.items() if adjusted[other] >= min(p, ALPHA))
        for key, p in adjusted.items()
    }
    decisions = {}
    for key, test in tests.items():
        p = adjusted.get(key)
        sure = p is not None and p < ALPHA
        verdict: Verdict = "different" if sure else CANNOT_TELL
        estimate, needed = Decision.estimate, None
        if isinstance(test, Difference):
            low, high = test.interval(ALPHA if p is None else ALPHA * test.weight / divisor[key])
            if sure:
                low, high = (max(low, 0.0), high) if test.value > 0 else (low, min(high, 0.0))
            elif p is not None:
                low, high = min(low, 0.0), max(high, 0.0)
                if -margin <= low and high <= margin:
                    verdict = "equal"
            estimate = Estimate(test.value, low, high, test.n)
            if verdict == CANNOT_TELL and test.discordant is not None:
                pairs = pairs_needed(margin, test.discordant, ALPHA * test.weight / total)
                needed = pairs if pairs > test.n else None
        decisions[key] = Decision(test, p, verdict, len(asked), estimate, needed)
    return decisions


def gap_words(decision: Decision) -> str:
    """Return a gap (reference minus target) in words, in points of success."""
    gap = decision.estimate
    if decision.refused:
        return f"{CANNOT_TELL}: {decision.refused}"
    ends = sorted((100 * abs(gap.low), 100 * abs(gap.high)))
    if decision.verdict == "equal":
        return f"holds, to within {ends[1]:.0f} points"
    if decision.certain:
        word = "loses" if gap.value > 0 else "gains"
        return f"{word} {100 * abs(gap.value):.0f} points ({ends[0]:.0f} to {ends[1]:.0f})"
    worst, best = round(100 * gap.high), round(-100 * gap.low)
    return f"{CANNOT_TELL}: anything from {worst} points lost to {best} gained"


# 5. How many pairs it takes


@lru_cache(maxsize=4096)
def pairs_needed(difference: float, discordant: float, alpha: float = ALPHA) -> int:
    """Return the number of pairs with which McNemar's exact test detects `difference` with probability POWER.

    Args:
        difference: difference of the two rates; its sign does not matter.
        discordant: share of pairs that end differently; it is taken to be at least the difference.
        alpha: level of the test; in a family of m, ALPHA / m at Holm's first step.

    Raises:
        UserError: a difference whose size is not within (0, 1].
    """
    d = abs(difference)
    if not 0 < d <= 1:
        raise UserError("not a difference of two success rates", expected="0 < difference <= 1", got=difference)
    psi = min(max(discordant, d), 1.0)
    low, high = 1, 2
    while exact_power(high, d, psi, alpha) < POWER:
        low, high = high, 2 * high
    while high - low > max(1, high // 200):  # power rises in steps, so 0.5 % is precise enough
        middle = (low + high) // 2
        low, high = (low, middle) if exact_power(middle, d, psi, alpha) >= POWER else (middle, high)
    return high


def exact_power(n: int, difference: float, discordant: float, alpha: float) -> float:
    """Return the probability that McNemar's exact test on n pairs is significant at level alpha.

    The number m of discordant pairs is binomial (n, discordant). Of these, the number in which only the first side
    succeeds is binomial (m, share).
    """
    share = (discordant + difference) / (2 * discordant)
    sd = math.sqrt(n * discordant * (1 - discordant))
    m = np.arange(max(0, int(n * discordant - 6 * sd)), min(n, int(n * discordant + 6 * sd) + 1) + 1)
    most = binom.ppf(alpha / 2, m, 0.5)  # the largest count of the rarer side that may be significant
    most = np.where(binom.cdf(most, m, 0.5) > alpha / 2, most - 1, most)
    found = binom.cdf(most, m, share) + binom.sf(m - most - 1, m, share)
    return float(np.sum(binom.pmf(m, n, discordant) * np.where(most >= 0, found, 0.0)))


# 6. Which factor costs what


def share(part: np.ndarray, total: np.ndarray) -> Estimate | None:
    """Return a part's share of a total with Fieller's interval; None where the total may be 0, or with two networks.

    Args:
        part, total: values (networks, episodes) of the same networks and episodes.
    """
    part, total = np.atleast_2d(part), np.atleast_2d(total)
    of_part, of_total, of_rest = (_moments([_Side(list(y), True)], paired=True) for y in (part, total, total - part))
    f, t = of_part.value, of_total.value
    q_f, q_t, q_rest = (m.half(ALPHA) ** 2 for m in (of_part, of_total, of_rest))
    a, b, c = t * t - q_t, f * t - (q_f + q_t - q_rest) / 2, f * f - q_f
    if a <= 0 or 1 < len(part) < FEWEST_NETWORKS:
        return None
    half = math.sqrt(max(b * b - a * c, 0.0))
    return Estimate(f / t, (b - half) / a, (b + half) / a, part.shape[1])


# 7. Whether one world tells the other

_RHO = np.linspace(-0.999, 0.999, 101)
_SPREAD = 0.6 * (np.arange(16) / 15) ** 2  # standard deviations of true rates, which cannot exceed .5 by much


def noise(first: Rows, second: Rows) -> np.ndarray:
    """Return the covariance (2, 2) of two measured rates, from their episodes, paired or not.

    One success and one failure are added to those seen, so that 20 of 20 is not taken as certain.
    """
    both = _shared({(side, t): row for side, rows in enumerate((first, second)) for t, row in rows.items()})
    sides = [_side(rows, both or _shared(rows)) for rows in (first, second)]
    y = [np.mean(side.rows, axis=0) if side.crossed else np.concatenate(side.rows) for side in sides]
    sd = np.array([math.sqrt((v.sum() + 1) * (len(v) - v.sum() + 1) / len(v)) / (len(v) + 2) for v in y])
    r = float(np.corrcoef(y[0], y[1])[0, 1]) if both and min(map(np.std, y)) > 0 else 0.0
    r *= 0.999  # the covariance for a correlation of 1 could not be inverted
    return np.outer(sd, sd) * np.array([[1.0, r], [r, 1.0]])


def correlation(x: np.ndarray, y: np.ndarray, noise: Sequence[np.ndarray]) -> Estimate:
    """Estimate the correlation of the true rates behind measured rates x and y (n,), given each pair's covariance.

    It maximises the restricted likelihood of (x, y) ~ N(mean, [[a^2, r a b], [r a b, b^2]] + noise), profiled over
    mean, a and b on a grid. The threshold on its drop is widened by n / (n - 3), the small-sample variance of Fisher's
    z. NaN with fewer than four points.

    Args:
        x, y: measured rates (n,).
        noise: covariance (2, 2) of each pair, see `noise`.
    """
    n = len(x)
    if n < 4:
        return Estimate(math.nan, math.nan, math.nan, n)
    r, a, b = np.meshgrid(_RHO, _SPREAD, _SPREAD, indexing="ij")
    log = np.zeros(r.shape)  # twice the log-likelihood
    w_x, w_y, w_c, s_x, s_y = (np.zeros(r.shape) for _ in range(5))  # weights and weighted sums
    for x_i, y_i, cov in zip(x, y, noise, strict=True):
        v_x, v_y, c = a * a + cov[0, 0], b * b + cov[1, 1], r * a * b + cov[0, 1]
        det = v_x * v_y - c * c
        t_x, t_y = (v_y * x_i - c * y_i) / det, (v_x * y_i - c * x_i) / det
        log -= np.log(det) + t_x * x_i + t_y * y_i
        w_x, w_y, w_c, s_x, s_y = w_x + v_y / det, w_y + v_x / det, w_c - c / det, s_x + t_x, s_y + t_y
    det = w_x * w_y - w_c * w_c
    log += (w_y * s_x**2 - 2 * w_c * s_x * s_y + w_x * s_y**2) / det - np.log(det)
    profile = log.max(axis=(1, 2))
    inside = _RHO[profile.max() - profile <= chi2.ppf(LEVEL, 1) * n / (n - 3)]
    found = (_RHO[profile.argmax()], inside.min(), inside.max())
    value, low, high = (float(np.sign(r)) if abs(r) == _RHO[-1] else float(r) for r in found)
    return Estimate(value, low, high, n)


def ceiling(x: np.ndarray, y: np.ndarray, noise: Sequence[np.ndarray]) -> float:
    """Return the largest correlation that x and y (n,), measured with noise, can be expected to show.

    It is that of two sides with a true correlation of 1: (s_x s_y + c) / sqrt((s_x^2 + v_x) (s_y^2 + v_y)), with the
    variances s^2 of the true rates over policies and the mean covariance [[v_x, c], [c, v_y]] of the `noise`. If one
    side is known exactly, it is sqrt(V / (V + mean p (1 - p) / n)). It is 0 where rates vary no more than their noise,
    and NaN with fewer than three points.
    """
    if len(x) < 3:
        return math.nan
    (v_x, c), (_, v_y) = np.mean(noise, axis=0)
    s_x, s_y = (max(float(np.var(side, ddof=1)) - v, 0.0) for side, v in ((x, v_x), (y, v_y)))
    if not s_x or not s_y:
        return 0.0
    return float((math.sqrt(s_x * s_y) + c) / math.sqrt((s_x + v_x) * (s_y + v_y)))


def measured_correlation(x: np.ndarray, y: np.ndarray) -> float:
    """Return Pearson's correlation of x and y (n,); NaN where a side does not vary."""
    return float(np.corrcoef(x, y)[0, 1]) if min(np.ptp(x), np.ptp(y)) > 0 else math.nan


def mean_interval(values: np.ndarray) -> Estimate:
    """Return the mean of differences of success (n,) with its t interval; with fewer than three, its ends are NaN."""
    n, value = len(values), float(np.mean(values))
    if n < FEWEST_NETWORKS:
        return Estimate(value, math.nan, math.nan, n)
    half = -float(stdtrit(n - 1, ALPHA / 2)) * float(np.std(values, ddof=1)) / math.sqrt(n)
    return Estimate(value, max(-1.0, value - half), min(1.0, value + half), n)


def mmrv(target: np.ndarray, reference_order: np.ndarray, target_order: np.ndarray) -> float:
    """Return the mean maximum rank violation.

    It is the mean over i of the largest |r_i - r_j| among the j that the two worlds order differently (X. Li et al.,
    Evaluating Real-World Robot Manipulation Policies in Simulation, CoRL 2024).

    Args:
        target: success r (n,) in the target world.
        reference_order, target_order: (n, n), 1 where i is found better than j, -1 where worse, 0 where the data cannot
            tell; so an order that chance reverses is not a violation.
    """
    violated = reference_order * target_order < 0
    return float(np.mean(np.max(np.abs(target[:, None] - target) * violated, axis=1)))


# 8. What the simulator is worth in real trials

_CORNER = 0.25  # weight of each of four uncorrelated pairs that are added to the data, see `paired_correlation`


def paired_correlation(y: np.ndarray, f: np.ndarray) -> Estimate:
    """Return the correlation of real outcomes y (n,) with simulation's of the same trials, f (n,), and its interval.

    A real outcome is 0 or 1; a simulated one may be a mean over replays.

    Outcomes are not normal, so the variance of Fisher's z is that of r's influence function. It is taken without and
    with four uncorrelated pairs of weight 1/4, because a few trials that all agree show no variance. The interval
    covers both, and Fisher's own. If a side does not vary, the correlation is NaN and the interval -1 to 1.
    """
    n = len(y)
    if n < 4 or min(np.ptp(y), np.ptp(f)) == 0:
        return Estimate(math.nan, -1.0, 1.0, n)
    corners = np.array([(a, b) for a in (0.0, 1.0) for b in (f.mean() - f.std(), f.mean() + f.std())])
    extended = np.concatenate([np.stack([y, f], axis=1), corners])
    weight = np.concatenate([np.ones(n), np.full(len(corners), _CORNER)])
    r, ends = measured_correlation(y, f), []
    for values, w in ((extended[:n], weight[:n]), (extended, weight)):
        z = (values - np.average(values, axis=0, weights=w)) / np.sqrt(_variance(values, w))
        r_w = float(np.average(z[:, 0] * z[:, 1], weights=w))
        influence = z[:, 0] * z[:, 1] - r_w / 2 * (z**2).sum(axis=1)
        inverse_slope = max(1 - r_w * r_w, 1e-9)  # of Fisher's z
        sd = math.sqrt(float(np.average(influence**2, weights=w)) / (w.sum() - 3)) / inverse_slope
        ends += [_fisher_z(r_w) + s * sd for s in _two_sided(w.sum() - 2)]
    ends += [_fisher_z(r) + s * float(norm.ppf(1 - ALPHA / 2)) / math.sqrt(n - 3) for s in (-1.0, 1.0)]
    return Estimate(r, min(r, math.tanh(min(ends))), max(r, math.tanh(max(ends))), n)


def _fisher_z(r: float) -> float:
    """Return Fisher's z of a correlation, finite also for -1 and 1."""
    return math.atanh(math.copysign(min(abs(r), 1 - 1e-9), r))


def _two_sided(df: float) -> tuple[float, float]:
    """Return the two t quantiles of a 95 % interval."""
    quantile = -float(stdtrit(df, ALPHA / 2))
    return -quantile, quantile


def _variance(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the weighted variance of each column."""
    return np.average((values - np.average(values, axis=0, weights=weights)) ** 2, axis=0, weights=weights)


@dataclass(frozen=True)
class Worth:
    """Value of a simulator, in equivalent real trials.

    Attributes:
        rho: correlation of the n trials' outcomes with simulation's of the same trials.
        trials: number of further trials that it is worth, n rho^2 / (1 - rho^2); 0 for a negative rho.
    """

    rho: Estimate
    trials: Estimate

    @property
    def buys(self) -> bool | None:
        """Whether it is surely worth a fifth of the trials that were made; None with fewer than FEWEST_PAIRED."""
        return None if self.rho.n < FEWEST_PAIRED else self.trials.low >= BUYS * self.rho.n

    @property
    def words(self) -> str:
        """The value in one sentence."""
        n, rho, trials = self.rho.n, self.rho, self.trials
        if n < FEWEST_PAIRED:
            return f"{CANNOT_TELL} what the simulator is worth: {n} paired trials, {FEWEST_PAIRED} are needed"
        if math.isnan(rho.value):
            return f"{CANNOT_TELL} what the simulator is worth: on one side all of {n} paired trials end alike"
        numbers = f"{n} paired trials, rho {rho.value:.2f} ({rho.low:.2f} to {rho.high:.2f})"
        if not self.buys:
            least = f"it surely is worth {_count(trials.low)} further trials, under a fifth of {n}"
            return f"the simulator buys nothing for judging this policy: {numbers}; {least}"
        ends = f"{_count(trials.low)} to {_count(trials.high)}"
        return f"the simulator is worth {_count(trials.value)} further trials ({ends}): {numbers}"


def _count(trials: float) -> str:
    return f"{trials:.0f}" if trials < 1000 else "over 1000"


def worth(y: np.ndarray, f: np.ndarray) -> Worth:
    """Return the value of simulated outcomes f (n,) for the real outcomes y (n,) of the same trials."""
    rho = paired_correlation(y, f)

    def further(r: float) -> float:
        return math.nan if math.isnan(r) else len(y) * max(r, 0.0) ** 2 / max(1 - r * r, 1e-9)

    return Worth(rho, Estimate(further(rho.value), further(rho.low), further(rho.high), len(y)))
