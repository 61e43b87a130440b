"""Intervals against published examples, the equations that define them, and their coverage in simulation."""

from math import comb, sqrt

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.evaluation.statistics.crossed import Block, contrast, crossed_bootstrap, difference, rate, spread
from vispeg.evaluation.statistics.intervals import Z, paired_difference, tango_score, unpaired_difference, wilson


def pairs(a, b, c, d):
    """Outcomes with a both, b first only, c second only, d neither."""
    first = np.array([1] * (a + b) + [0] * (c + d), bool)
    return first, np.array([1] * a + [0] * b + [1] * c + [0] * d, bool)


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


def test_paired_difference_gives_fagerland_2014_airway_example():
    e = paired_difference(*pairs(1, 1, 7, 12))
    assert (e.value, e.low, e.high) == pytest.approx((-6 / 21, -0.517, -0.026), abs=5e-4)


@pytest.mark.parametrize("table", [(30, 9, 2, 4), (95, 5, 0, 0), (0, 0, 20, 0), (10, 1, 1, 3)])
def test_paired_ends_are_where_the_score_test_turns(table):
    e = paired_difference(*pairs(*table))
    for end, score in ((e.low, Z), (e.high, -Z)):
        if abs(end) < 1 - 1e-9:
            assert tango_score(table[1], table[2], sum(table), end) == pytest.approx(score, abs=1e-5)
    mirrored = paired_difference(*pairs(*table)[::-1])
    assert (mirrored.low, mirrored.high) == pytest.approx((-e.high, -e.low), abs=1e-8)


def test_paired_difference_without_discordance_has_its_closed_form():
    e = paired_difference(*pairs(50, 0, 0, 0))
    assert (e.value, e.high, e.low) == pytest.approx((0, Z**2 / (50 + Z**2), -(Z**2) / (50 + Z**2)))


def test_unpaired_difference_gives_newcombe_1998_table_ii():
    e = unpaired_difference((56, 48), (70, 80))
    assert (e.value, e.low, e.high) == pytest.approx((0.2, 0.0524, 0.3339), abs=5e-5)


def test_paired_coverage_summed_exactly_over_every_table():
    n, p10, p01 = 30, 0.15, 0.05
    covered = 0.0
    for b in range(n + 1):
        for c in range(n + 1 - b):
            chance = comb(n, b) * comb(n - b, c) * p10**b * p01**c * (1 - p10 - p01) ** (n - b - c)
            if chance > 1e-9:
                covered += chance * (not paired_difference(*pairs(n - b - c, b, c, 0)).excludes(p10 - p01))
    assert 0.94 < covered < 0.97


def test_variance_of_the_mean_is_unbiased_for_crossed_normal_effects():
    rng, k, n, sa, sb, se = stream(0, "crossed"), 4, 12, 1.5, 0.7, 1.0
    found, means = [], []
    for _ in range(3000):
        y = sa * rng.standard_normal((k, 1)) + sb * rng.standard_normal((1, n)) + se * rng.standard_normal((k, n))
        value, variance, _ = spread([Block(y)])
        found.append(variance)
        means.append(value)
    truth = sa**2 / k + sb**2 / n + se**2 / (k * n)
    assert np.mean(found) == pytest.approx(truth, rel=0.05) and np.var(means) == pytest.approx(truth, rel=0.1)


def test_three_training_seeds_are_covered_where_pooling_is_not(bernoulli):
    rng = stream(1, "coverage")
    odds = 2 + 0.5 * rng.standard_normal(200_000) + rng.standard_normal(200_000)
    truth, runs = float(np.mean(1 / (1 + np.exp(-odds)))), 300
    ours = pooled = boot = 0
    for i in range(runs):
        y = bernoulli(rng, 3, 200, 2, 0.5, 1)
        ours += not rate(y).excludes(truth)
        pooled += not wilson(int(y.sum()), y.size).excludes(truth)
        if i < 60:
            boot += not crossed_bootstrap(lambda b: float(b[0].mean()), [y], rng, 200).excludes(truth)
    assert ours / runs > 0.9 and pooled / runs < 0.7 and 0.7 < boot / 60


def test_one_network_keeps_wilson_and_tango():
    y = np.array([1] * 17 + [0] * 3)
    assert rate(y) == wilson(17, 20)
    z = np.array([0] * 5 + [1] * 15)
    assert difference(y, z, same_networks=True) == paired_difference(y > 0, z > 0)


def test_all_successes_leave_the_bound_of_the_episodes_counted_once():
    e = rate(np.ones((3, 100)))
    assert (e.value, e.low, e.n) == (1.0, wilson(100, 100).low, 300)
    e = difference(np.ones((3, 100)), np.ones((3, 100)), same_networks=True)
    assert e.high == pytest.approx(Z**2 / (100 + Z**2))


def test_a_seed_shared_by_both_worlds_cancels_in_the_gap_of_one_policy_only(bernoulli):
    y = bernoulli(stream(3, "shared"), 3, 300, 1, 1.5, 0)
    worse = y.copy()
    worse[:, :30] = 0
    same, other = difference(y, worse, True), difference(y, worse, False)
    assert same.half < 0.5 * other.half and same.value == pytest.approx(other.value)


def test_a_contrast_does_not_depend_on_the_order_of_episodes_or_seeds(bernoulli):
    rng = stream(4, "order")
    a, b = bernoulli(rng, 3, 50, 1, 1, 1), bernoulli(rng, 4, 50, 0, 1, 1)
    columns = rng.permutation(50)
    moved = contrast([Block(a[::-1][:, columns]), Block(-b[:, columns])])
    assert moved.to_json() == pytest.approx(contrast([Block(a), Block(-b)]).to_json())


def test_bad_input_is_named():
    with pytest.raises(UserError, match="count of successes"):
        wilson(3, 2)
    with pytest.raises(UserError, match="paired"):
        paired_difference(np.ones(3), np.ones(4))
    with pytest.raises(UserError, match="different episodes"):
        contrast([Block(np.ones((2, 3))), Block(np.ones((2, 4)))])
