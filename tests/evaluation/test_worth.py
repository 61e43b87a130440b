"""What bounds a correlation, and what a simulator is worth in real trials: against simulation and closed forms."""

import math

import numpy as np
import pytest

from vispeg.core.seeds import stream
from vispeg.evaluation.gap import gap
from vispeg.evaluation.records import Episode
from vispeg.evaluation.statistics import (
    BUYS,
    CANNOT_TELL,
    FEWEST_PAIRED,
    ceiling,
    measured_correlation,
    paired_correlation,
    worth,
)

# how a robot's outcome and what simulation says of the same start hang together
PAIRED = {
    "unrelated": lambda rng, n: (rng.random(n) < 0.6, rng.binomial(20, 0.9, n) / 20),
    "weak": lambda rng, n: _drawn(rng, rng.beta(8, 3, n), 20),
    "moderate": lambda rng, n: _drawn(rng, rng.beta(1, 1, n), 20),
    "strong": lambda rng, n: _drawn(rng, rng.choice([0.05, 0.95], n, p=[0.3, 0.7]), 1000),
    "one replay": lambda rng, n: _flipped(rng, n, 0.8, 0.15),
    "one replay that nearly always agrees": lambda rng, n: _flipped(rng, n, 0.85, 0.03),
}


def _drawn(rng, p, replays):
    return rng.random(len(p)) < p, rng.binomial(replays, p) / replays


def _flipped(rng, n, p, off):
    y = rng.random(n) < p
    return y, np.where(rng.random(n) < off, ~y, y).astype(float)


@pytest.mark.parametrize("kind", PAIRED)
@pytest.mark.parametrize("n", [FEWEST_PAIRED, 60])
def test_the_lower_end_of_what_a_simulator_is_worth_is_rarely_too_high(kind, n):
    rng, draw = stream(0, "worth", kind, str(n)), PAIRED[kind]
    y, f = draw(rng, 400_000)
    true = float(np.corrcoef(y, f)[0, 1])
    inside = under = 0
    for _ in range(600):
        y, f = draw(rng, n)
        rho = paired_correlation(y.astype(float), f)
        inside += rho.low <= true <= rho.high
        under += rho.low <= true
    assert under / 600 >= 0.96 and inside / 600 >= 0.93, (true, under / 600, inside / 600)


def test_what_it_is_worth_is_what_a_control_variate_saves():
    """The variance of the robot's rate, with simulation's mean known, is that of n / (1 - rho^2) trials."""
    rng, n = stream(0, "control variate"), 40
    y, f = PAIRED["moderate"](rng, 400_000)
    rho = float(np.corrcoef(y, f)[0, 1])
    slope, centre = rho * y.std() / f.std(), f.mean()
    plain, corrected = [], []
    for _ in range(4000):
        a, b = PAIRED["moderate"](rng, n)
        plain.append(a.mean())
        corrected.append(a.mean() - slope * (b.mean() - centre))
    assert np.var(plain) / np.var(corrected) == pytest.approx(1 / (1 - rho**2), rel=0.08)
    found = worth(y.astype(float), f)
    assert len(y) / (1 - rho**2) == pytest.approx(len(y) + found.trials.value) and found.buys


def test_a_simulator_that_tells_little_buys_nothing_and_few_trials_tell_nothing():
    rng = stream(0, "nothing")
    y = (rng.random(40) < 0.5).astype(float)
    nothing = worth(y, rng.permutation(y))
    assert nothing.buys is False and nothing.words.startswith("the simulator buys nothing for judging this policy")
    assert worth(y, 1 - y).buys is False, "one that contradicts the robot"
    same = worth(y, y)
    assert same.buys and same.trials.low >= BUYS * 40 and "further trials" in same.words
    for few in (worth(y[: FEWEST_PAIRED - 1], y[: FEWEST_PAIRED - 1]), worth(y, np.ones(40))):
        assert few.words.startswith(CANNOT_TELL) and not few.buys


def test_the_ceiling_is_that_of_a_simulator_that_knows_every_rate():
    """Rates of standard deviation .25 about .5 and ten trials each: .88, by the formula, in the mean over draws."""
    rng, n, k = stream(0, "ceiling"), 10, 16
    a = 0.5 * (0.25 / 0.0625 - 1)  # beta(a, a) has variance 1 / (4 (2 a + 1))
    formula = math.sqrt(0.0625 / (0.0625 + (0.25 - 0.0625) / n))
    assert formula == pytest.approx(0.877, abs=0.001)
    p = rng.beta(a, a, 200_000)
    y = rng.binomial(n, p) / n
    noise = [np.diag([0.0, v]) for v in y * (1 - y) / (n - 1)]
    assert measured_correlation(p, y) == pytest.approx(formula, abs=0.005)
    assert ceiling(p, y, noise) == pytest.approx(formula, abs=0.005)
    few = []
    for _ in range(400):
        p = rng.beta(a, a, k)
        y = rng.binomial(n, p) / n
        few.append((measured_correlation(p, y), ceiling(p, y, [np.diag([0.0, v]) for v in y * (1 - y) / (n - 1)])))
    seen, most = np.array(few).T
    assert np.nanmean(most) == pytest.approx(np.nanmean(seen), abs=0.03)


def test_noise_on_both_sides_lowers_the_ceiling_and_shared_episodes_raise_it():
    rng, n = stream(0, "both"), 20
    p = rng.beta(2, 2, 100_000)
    hard = rng.random((len(p), n))
    ends = hard < p[:, None]
    x, y = ends.mean(axis=1), rng.binomial(n, p) / n
    v = float(np.mean(p * (1 - p)) / n)
    apart, same = np.array([[v, 0.0], [0.0, v]]), np.full((2, 2), v)
    assert ceiling(x, y, [apart]) == pytest.approx(measured_correlation(x, y), abs=0.01)
    assert ceiling(x, x, [same]) == pytest.approx(1.0)
    assert ceiling(np.full(9, 0.5), y[:9], [apart]) == 0.0 and math.isnan(ceiling(x[:2], y[:2], [apart]))


def test_a_gap_says_what_simulation_is_worth_where_trials_are_paired_and_never_r_alone():
    rng = stream(0, "gap page")

    def played(policy, world, ends, first=1_000_000):
        digest = "" if world == "robot" else "h"
        head = (policy, "depth", 0, world, digest)
        return [Episode(*head, first + s, bool(ok), "success" if ok else "jam") for s, ok in enumerate(ends)]

    every, other = [], []
    for k, p in enumerate(np.linspace(0.2, 0.9, 9)):
        ends = rng.random(60) < p
        there = np.where(rng.random(60) < 0.1, ~ends, ends)
        every += played(f"p{k}", "S", ends) + played(f"p{k}", "robot", there)
        other += played(f"p{k}", "S", ends) + played(f"p{k}", "robot", there, first=1)
    found = gap(every)
    assert sum(g["worth"]["buys"] for g in found["gaps"]) >= 7
    (row,) = found["prediction"]
    assert row["measured"] and 0 < row["ceiling"] <= 1.0 and f"of at most {row['ceiling']:.2f}" in row["words"]
    assert {g["worth"] for g in gap(other)["gaps"]} == {None}, "a trial's number is no start"
