"""Intervals, tests and decisions: published examples, the equations that define them, and their rates in simulation."""

from math import comb, sqrt

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import binom, mannwhitneyu, norm

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.evaluation.statistics import (
    ALPHA,
    CANNOT_TELL,
    Hypothesis,
    by_ranks,
    contrast,
    correlation,
    decide,
    difference,
    exact_power,
    fall,
    gap_words,
    holm,
    mcnemar,
    mean_interval,
    mmrv,
    newcombe,
    noise,
    pairs_needed,
    rate,
    rate_words,
    share,
    tango,
    tango_score,
    wilson,
)

Z = float(norm.ppf(1 - ALPHA / 2))


def rows(y, name=lambda t, j: j):
    """(networks, episodes) as rows; by default all networks played the same episodes."""
    return {t: {name(t, j): float(v) for j, v in enumerate(row)} for t, row in enumerate(np.atleast_2d(y))}


def table(a, b, c, d):
    """Outcomes with a both, b first only, c second only, d neither."""
    return rows([1] * (a + b) + [0] * (c + d)), rows([1] * a + [0] * b + [1] * c + [0] * d)


def alone(first, second, same=True):
    """The decision on a page with one comparison."""
    return decide({"it": difference(first, second, same)})["it"]


@pytest.mark.parametrize(
    ("x", "n", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_gives_newcombe_1998_table_i(x, n, low, high):
    e = wilson(x, n)
    assert (e.low, e.high) == pytest.approx((low, high), abs=5e-5)


def test_wilson_of_twenty_of_twenty_is_the_paper_robots_83_9_percent_and_solves_its_equation():
    assert wilson(20, 20).low == pytest.approx(1 / (1 + Z**2 / 20)) == pytest.approx(0.839, abs=5e-4)
    e = wilson(37, 50)
    for p in (e.low, e.high):
        assert abs(0.74 - p) / sqrt(p * (1 - p) / 50) == pytest.approx(Z)


def test_tango_gives_fagerland_2014_airway_example():
    assert tango(1, 7, 21) == pytest.approx((-0.517, -0.026), abs=5e-4)


@pytest.mark.parametrize("counts", [(30, 9, 2, 4), (95, 5, 0, 0), (0, 0, 20, 0), (10, 1, 1, 3)])
@pytest.mark.parametrize("alpha", [0.05, 0.001])
def test_paired_ends_are_where_the_score_test_turns(counts, alpha):
    _, b, c, _ = counts
    n, z = sum(counts), float(norm.ppf(1 - alpha / 2))
    low, high = tango(b, c, n, alpha)
    for end, score in ((low, z), (high, -z)):
        if abs(end) < 1 - 1e-9:
            assert tango_score(b, c, n, end) == pytest.approx(score, abs=1e-5)
    assert tango(c, b, n, alpha) == pytest.approx((-high, -low), abs=1e-8)


def test_paired_difference_without_discordance_has_its_closed_form():
    assert tango(0, 0, 50) == pytest.approx((-(Z**2) / (50 + Z**2), Z**2 / (50 + Z**2)))


def test_newcombe_gives_his_1998_table_ii():
    assert newcombe((56, 48), (70, 80)) == pytest.approx((0.0524, 0.3339), abs=5e-5)


def test_paired_coverage_summed_exactly_over_every_table():
    n, p10, p01 = 30, 0.15, 0.05
    covered = 0.0
    for b in range(n + 1):
        for c in range(n + 1 - b):
            chance = comb(n, b) * comb(n - b, c) * p10**b * p01**c * (1 - p10 - p01) ** (n - b - c)
            if chance > 1e-9:
                low, high = tango(b, c, n)
                covered += chance * (low <= p10 - p01 <= high)
    assert 0.94 < covered < 0.97


@pytest.mark.parametrize(("b", "c"), [(1, 7), (0, 5), (0, 6), (12, 12), (3, 17)])
def test_mcnemar_is_the_binomial_sum(b, c):
    p = min(1.0, 2 * sum(comb(b + c, i) for i in range(min(b, c) + 1)) / 2 ** (b + c))
    assert mcnemar(b, c) == pytest.approx(p)
    assert difference(*table(20, b, c, 3), True).p == pytest.approx(p), "only discordant pairs count"


def test_mcnemar_gives_fagerland_2014_and_five_discordant_pairs_are_never_significant():
    assert mcnemar(1, 7) == pytest.approx(0.0703, abs=5e-5) and mcnemar(0, 0) == 1.0
    assert mcnemar(0, 5) > 0.05 > mcnemar(0, 6)
    five = alone(*table(55, 5, 0, 0))
    assert five.verdict == CANNOT_TELL and five.estimate.low == 0.0, "the interval says what the verdict says"


def test_holm_gives_published_values_whatever_the_order():
    p = [0.01, 0.02, 0.03, 0.04, 0.05]
    assert holm(p) == pytest.approx([0.05, 0.08, 0.09, 0.09, 0.09])
    assert holm(p[::-1]) == pytest.approx(holm(p)[::-1])
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([]) == []
    assert holm([0.01, 0.02], [1, 1]) == pytest.approx(holm([0.01, 0.02]))
    assert holm([0.01, 0.01, 0.02], [0.5, 0.5, 1.0]) == pytest.approx([0.04, 0.04, 0.04])  # two that share one's weight


def test_an_interval_excludes_nothing_exactly_where_the_verdict_is_different():
    rng = stream(0, "dual")
    tests = {
        i: difference(rows(rng.uniform(size=n) < 0.9), rows(rng.uniform(size=n) < 0.9 - 0.04 * (i % 8)), True)
        for i, n in enumerate(rng.integers(10, 150, size=60))
    }
    tests |= {
        (i, k): difference(rows(rng.uniform(size=(k, 60)) < 0.9), rows(rng.uniform(size=(k, 60)) < 0.6), i > 1)
        for i in range(4)
        for k in (3, 5)
    }
    decided = decide(tests)
    verdicts = [d.verdict for d in decided.values()]
    assert 5 < verdicts.count("different") < 60
    for d in decided.values():
        assert d.certain or d.estimate.low <= 0 <= d.estimate.high
        assert not d.certain or d.estimate.low >= 0 or d.estimate.high <= 0
        assert d.certain == (d.p_holm is not None and d.p_holm < 0.05)
        assert not (d.certain and CANNOT_TELL in gap_words(d)) and ("loses" in gap_words(d)) <= d.certain


def test_the_rule_tells_different_equal_and_cannot_tell_in_words_that_follow():
    assert gap_words(alone(*table(60, 26, 3, 11))).startswith("loses 23 points (")
    assert gap_words(alone(*table(60, 3, 26, 11))).startswith("gains 23 points (")
    assert gap_words(alone(*table(880, 5, 5, 10))).startswith("holds, to within")
    few = alone(*table(26, 4, 0, 0))
    assert gap_words(few) == f"{CANNOT_TELL}: anything from 30 points lost to 0 gained" and few.needed > 30
    many = {i: difference(*table(50, 7, 0, 3), True) for i in range(12)}
    assert difference(*table(50, 7, 0, 3), True).p < 0.05
    assert {d.verdict for d in decide(many).values()} == {CANNOT_TELL}, "twelve side by side say less than one alone"


def test_episodes_that_only_one_side_played_make_no_pair_and_one_shared_number_makes_no_comparison_of_one():
    first, second = rows([1] * 50 + [0] * 10), rows([1] * 30 + [0] * 30, lambda t, j: 59 + j)
    found = difference(first, second, True)
    assert not found.paired and found.n == 60, "59 is the one seed of both"
    assert found.interval(0.05) == pytest.approx(newcombe((50, 30), (60, 60)))
    part = difference(first, rows([1] * 30 + [0] * 10), True)
    assert part.paired and part.n == 40, "whoever played less played nothing else"


def test_trials_of_several_networks_that_are_numbered_on_are_all_counted():
    on = rows(np.ones((2, 20)), lambda t, j: 20 * t + j)
    overlap = rows([[1] * 20, [0] * 20], lambda t, j: 19 * t + j)  # number 19 is of both
    assert rate(on).n == rate(overlap).n == 40 and rate(overlap).value == 0.5


def test_a_rate_counts_all_episodes_of_networks_that_played_unequally_many():
    first = {0: {s: float(s < 50) for s in range(100)}, 1: {s: 1.0 for s in range(50)}}
    assert rate(first).value == 0.75 and rate(first).n == 150, "the first 50, which both have, all succeed"
    trials = {0: {s: 1.0 for s in range(10)}, 1: {s: 0.0 for s in range(2)}}
    assert rate(trials).value == 0.5
    assert rate_words(rate(trials), 10).startswith("10 of 12: ")


def test_one_network_keeps_wilson_and_tango():
    y = [1] * 17 + [0] * 3
    assert rate(rows(y)) == wilson(17, 20)
    assert difference(rows([0] * 5 + [1] * 15), rows(y), True).interval(0.05) == tango(3, 5, 20)


def test_all_successes_leave_the_bound_of_the_episodes_counted_once():
    e = rate(rows(np.ones((3, 100))))
    assert (e.value, e.low, e.n) == (1.0, wilson(100, 100).low, 300)
    same = difference(rows(np.ones((3, 100))), rows(np.ones((3, 100))), True)
    assert same.p == 1.0 and 0 < same.interval(0.05)[1] < 0.1
    lost = alone(rows(np.ones((3, 100))), rows(np.zeros((3, 100))))
    assert lost.certain and lost.p_holm > 0, "nothing is known without doubt"


def test_under_three_training_seeds_nothing_is_said_of_a_recipe():
    good, bad = np.ones((3, 60)), np.zeros((3, 60))
    for a, b in ((2, 2), (1, 3), (2, 3), (1, 2)):
        d = alone(rows(good[:a]), rows(bad[:b]), same=False)
        assert d.verdict == CANNOT_TELL and d.p_holm is None and "training seeds" in gap_words(d), (a, b)
    assert alone(rows(good), rows(bad), same=False).certain
    scripted = difference(rows(good[:1]), rows(bad), False, trained=(False, True))
    assert decide({"it": scripted})["it"].certain, "a scripted policy is no sample of anything"


def test_a_seed_shared_by_both_worlds_cancels_in_the_gap_of_one_policy_only(bernoulli):
    y = bernoulli(stream(3, "shared"), 4, 300, 1, 1.5, 0)
    worse = y.copy()
    worse[:, :30] = 0
    same, other = (difference(rows(y), rows(worse), flag) for flag in (True, False))
    width = [np.ptp(d.interval(0.05)) for d in (same, other)]
    assert width[0] < 0.5 * width[1] and same.value == pytest.approx(other.value)


def test_a_contrast_does_not_depend_on_the_order_of_episodes_or_seeds(bernoulli):
    rng = stream(4, "order")
    a, b = bernoulli(rng, 3, 50, 1, 1, 1), bernoulli(rng, 4, 50, 0, 1, 1)
    columns = rng.permutation(50)
    moved, before = contrast(a[::-1][:, columns], -b[:, columns]), contrast(a, -b)
    assert (moved.p, *moved.interval(0.01)) == pytest.approx((before.p, *before.interval(0.01)))


COVERAGE = [  # training seeds, success, spread between them in log-odds; % of pooled Wilson, a rate, a gap, two recipes
    (3, 0.84, 0, 92, 98, 96, 97),
    (3, 0.84, 0.5, 57, 96, 96, 97),
    (3, 0.82, 1, 32, 95, 95, 96),
    (3, 0.5, 0.5, 48, 96, 96, 96),
    (5, 0.84, 0.5, 54, 95, 95, 95),
    (5, 0.5, 0.5, 46, 96, 95, 96),
]  # of 4,000 draws each, 200 episodes; the gap is to a world that is 0.7 harder in log-odds


@pytest.mark.parametrize(("k", "success", "spread", *"wrgp"), COVERAGE)
def test_intervals_over_training_seeds_cover_what_is_stated(k, success, spread, w, r, g, p):
    """The stated coverage by other draws: pooled Wilson, a rate, a gap, two recipes; all but the first near 95 %."""
    rng, k, runs = stream(1, "coverage", str((k, success, spread))), int(k), 500
    effects = rng.standard_normal((2, 200_000))
    odds = spread * effects[0] + effects[1]

    def mean(m):
        return float(np.mean(1 / (1 + np.exp(-m - odds))))

    m = brentq(lambda m: mean(m) - success, -5.0, 5.0)
    lost, hit = mean(m) - mean(m - 0.7), np.zeros(4)
    for _ in range(runs):
        luck, hard = spread * rng.standard_normal((2 * k, 1)), rng.standard_normal(200)
        here = rng.uniform(size=(2 * k, 200)) < 1 / (1 + np.exp(-m - luck - hard))
        there = rng.uniform(size=(k, 200)) < 1 / (1 + np.exp(0.7 - m - luck[:k] - hard))
        one, other, worse = rows(here[:k]), rows(here[k:]), rows(there)
        hit[0] += not wilson(int(here[:k].sum()), here[:k].size).excludes(success)
        hit[1] += not rate(one).excludes(success)
        for i, (second, same, truth) in enumerate(((worse, True, lost), (other, False, 0.0))):
            low, high = difference(one, second, same).interval(0.05)
            hit[2 + i] += low <= truth <= high
    stated = np.array([w, r, g, p]) / 100
    assert ((stated[1:] >= 0.93) & (stated[1:] <= 0.98)).all()
    assert (np.abs(hit / runs - stated) < 0.005 + 3.5 * np.sqrt(stated * (1 - stated) / runs)).all(), hit / runs


def test_a_recipe_of_two_networks_has_a_wide_rate(bernoulli):
    """Two tell next to nothing, and the rate's interval says so: it holds the truth of the recipe."""
    rng, inside = stream(1, "two"), 0
    odds = 2 + 0.5 * rng.standard_normal(200_000) + rng.standard_normal(200_000)
    truth = float(np.mean(1 / (1 + np.exp(-odds))))
    for _ in range(250):
        inside += not rate(rows(bernoulli(rng, 2, 200, 2, 0.5, 1))).excludes(truth)
    assert inside / 250 >= 0.93


def test_the_number_of_pairs_gives_the_power_it_promises_at_holms_first_step():
    rng = stream(0, "power")
    for m in (1, 6):
        p10, p01 = 0.15, 0.05
        n = pairs_needed(p10 - p01, p10 + p01, ALPHA / m)
        counts = rng.multinomial(n, [p10, p01, 1 - p10 - p01], size=2000)
        p = {(b, c): mcnemar(b, c) for b, c in {(int(b), int(c)) for b, c, _ in counts}}
        power = np.mean([p[int(b), int(c)] < ALPHA / m for b, c, _ in counts])
        assert 0.77 < power < 0.84 and exact_power(n, 0.1, 0.2, ALPHA / m) == pytest.approx(power, abs=0.03)
        assert exact_power(n - max(2, n // 100), 0.1, 0.2, ALPHA / m) < 0.8
    with pytest.raises(UserError):
        pairs_needed(0.0, 0.1)


def test_pairs_are_said_for_single_networks_and_above_what_was_played():
    few = alone(*table(20, 3, 1, 0))
    assert few.needed > few.estimate.n
    plenty = alone(*table(1800, 60, 40, 100))  # 5 points would have been found with these 2,000
    assert plenty.needed is None and plenty.verdict in ("equal", CANNOT_TELL)
    assert alone(rows(np.ones((3, 30))), rows(np.eye(3, 30) < 1)).needed is None, "pairs are no networks"


def test_a_share_of_a_loss_covers_the_truth():
    """A factor costs 15 % of a loss of 40 points, over hard and easy episodes."""
    rng, inside, runs = stream(0, "share"), 0, 500
    for _ in range(runs):
        u = rng.uniform(size=100)
        both = (u < 0.4).astype(float)[None]  # lost in the joint world
        of_it = (u < 0.06).astype(float)[None]
        found = share(of_it, both)
        inside += found is not None and not found.excludes(0.15)
    assert 0.92 <= inside / runs <= 0.985
    assert share(np.array([[0, 1, -1, 0, 1, -1]]), np.array([[0, 1, -1, 0, -1, 1]])) is None, "no loss, no share"


@pytest.mark.slow
def test_a_falls_interval_covers_the_truth_as_often_as_it_says():
    rng, inside, alarms = stream(0, "falls"), [0, 0], [0, 0]
    for _ in range(200):
        hard = rng.standard_normal(20)  # a seed that is hard is hard in all configurations
        y = [rng.uniform(size=(6, 20)) < 1 / (1 + np.exp(-m - 1.5 * hard)) for m in (1.5, 1.5)]
        for i, robot in enumerate((False, True)):
            there = (lambda t, j: ("trial", j)) if robot else (lambda t, j: j)
            found = fall([(rows(a), rows(b, there)) for a, b in zip(*y, strict=True)])
            low, high = found.interval(0.05)
            inside[i] += low <= 0 <= high
            alarms[i] += low > 0.05
            assert (found.p < 0.05) == (not low <= 0 <= high)
    assert all(0.92 <= n / 200 for n in inside) and max(alarms) == 0


def outcomes(rng, odds, n, hard):
    return (rng.uniform(size=n) < 1 / (1 + np.exp(-odds - hard))).astype(float)


@pytest.mark.parametrize(
    ("spread", "related", "n", "held"),
    [(0.0, True, 20, (-1, 1)), (1.5, True, 100, (0.6, 1)), (1.5, False, 100, (-0.8, 0.8))],
)
def test_a_correlation_of_noisy_rates_is_that_of_the_true_ones(spread, related, n, held):
    """Where rates do not differ it is anything; else it holds the truth, 1 or 0, in at least 9 of 10 draws."""
    rng, right, runs = stream(0, "correlation", str(spread), str(related)), 0, 16
    for _ in range(runs):
        odds = 1 + spread * rng.standard_normal((2, 16))
        odds[1] = odds[0] if related else odds[1]
        hard = rng.standard_normal(n)
        y = [[rows(outcomes(rng, o, n, hard)) for o in side] for side in odds]
        x = [np.array([rate(r).value for r in side]) for side in y]
        e = correlation(*x, [noise(a, b) for a, b in zip(*y, strict=True)])
        right += (e.low <= (1.0 if related else 0.0) <= e.high) and (spread == 0 or (e.low >= held[0]) or not related)
        if spread == 0:
            assert e.high > 0.6, "no alarm from noise"
    assert right >= 0.85 * runs


def test_a_mean_over_few_policies_covers_the_truth_and_over_two_is_not_given():
    rng = stream(0, "means")
    for n in (3, 4, 8):
        inside = sum(not mean_interval(0.1 * rng.standard_normal(n)).excludes(0.0) for _ in range(1000))
        assert 0.93 <= inside / 1000 <= 0.97, n
    assert np.isnan(mean_interval(np.array([0.1, 0.2])).low)


def brute_mmrv(r, s):
    worst = [max(abs(r[i] - r[j]) * ((s[i] - s[j]) * (r[i] - r[j]) < 0) for j in range(len(r))) for i in range(len(r))]
    return sum(worst) / len(r)


def order(s):
    s = np.asarray(s, float)
    return np.sign(s[:, None] - s)


def test_mmrv_of_counted_examples_and_against_the_definition():
    r = np.array([0.1, 0.5, 0.9])
    assert mmrv(r, order([1, 2, 3]), order(r)) == 0
    assert mmrv(r, order([3, 2, 1]), order(r)) == pytest.approx((0.8 + 0.4 + 0.8) / 3)
    assert mmrv(r, np.zeros((3, 3)), order(r)) == 0, "an order that the data cannot tell violates none"
    rng = stream(0, "mmrv")
    for _ in range(20):
        r, s = rng.integers(6, size=(2, 9)) / 5
        assert mmrv(r, order(s), order(r)) == pytest.approx(brute_mmrv(r, s))


def test_tests_of_other_things_are_in_the_family_too():
    decided = decide({"a": Hypothesis(0.04), "b": Hypothesis(0.04), "c": difference(*table(20, 8, 0, 3), True)})
    assert {key: d.verdict for key, d in decided.items()} == {"a": CANNOT_TELL, "b": CANNOT_TELL, "c": "different"}
    assert decide({"a": Hypothesis(0.04)})["a"].certain and decide({}) == {}


def test_bad_input_is_named():
    with pytest.raises(UserError, match="count of successes"):
        wilson(3, 2)
    with pytest.raises(UserError, match="no episodes"):
        rate({})
    assert "no network" in difference({0: {1: 1.0}}, {1: {1: 1.0}}, True).refused


def test_times_of_several_networks_are_no_independent_episodes():
    """Networks that are slower or faster in one world by chance: the pooled test of ranks would call half of them."""
    rng, pooled, called, pages = stream(0, "ranks"), 0, 0, 400
    for _ in range(pages):
        sides = [{t: dict(enumerate(rng.normal(0.5 * rng.standard_normal(), 1, 30))) for t in range(4)} for _ in "ab"]
        p = by_ranks(*sides)
        called += p < 0.05
        pooled += mannwhitneyu(*([v for row in side.values() for v in row.values()] for side in sides)).pvalue < 0.05
    assert pooled > 0.2 * pages and called <= binom.ppf(0.999, pages, 0.05)
    slower = [{t: dict(enumerate(rng.normal(2.0 * side, 1, 30))) for t in range(3)} for side in (0, 1)]
    assert by_ranks(*slower) < 0.05 and by_ranks(*({t: side[t] for t in (0, 1)} for side in slower)) is None
