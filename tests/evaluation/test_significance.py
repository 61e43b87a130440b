"""McNemar, Holm, sample size, rank measures: hand-counted examples, published ones, and error rates in simulation."""

from math import comb

import numpy as np
import pytest
from scipy.stats import pearsonr, spearmanr

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.evaluation.statistics.ranks import mmrv, predict
from vispeg.evaluation.statistics.significance import holm, mcnemar, pairs_needed


def outcomes(b, c, rest=20):
    return np.array([1] * b + [0] * c + [1] * rest), np.array([0] * b + [1] * c + [1] * rest)


@pytest.mark.parametrize(("b", "c"), [(1, 7), (0, 5), (0, 6), (12, 12), (3, 17)])
def test_mcnemar_is_the_binomial_sum(b, c):
    p = min(1.0, 2 * sum(comb(b + c, i) for i in range(min(b, c) + 1)) / 2 ** (b + c))
    found = mcnemar(*outcomes(b, c))
    assert found.p == pytest.approx(p) and (found.first_only, found.second_only) == (b, c)
    assert found.can_tell == (b + c >= 6)


def test_mcnemar_gives_fagerland_2014_and_only_discordant_pairs_count():
    assert mcnemar(*outcomes(1, 7)).p == pytest.approx(0.0703, abs=5e-5)
    assert mcnemar(*outcomes(1, 7, 0)).p == mcnemar(*outcomes(1, 7, 500)).p
    assert mcnemar(*outcomes(0, 0)).p == 1.0


def test_five_discordant_pairs_can_never_be_significant_six_can():
    assert mcnemar(*outcomes(0, 5)).p > 0.05 > mcnemar(*outcomes(0, 6)).p


def test_holm_gives_published_values_whatever_the_order():
    p = [0.01, 0.02, 0.03, 0.04, 0.05]
    assert holm(p) == pytest.approx([0.05, 0.08, 0.09, 0.09, 0.09])
    assert holm(p[::-1]) == pytest.approx(holm(p)[::-1])
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([]) == []


def test_family_wise_error_stays_below_five_percent_with_no_difference_anywhere():
    rng, wrong = stream(0, "family"), 0
    for _ in range(400):
        arms = rng.uniform(size=(4, 80)) < 0.7
        p = [mcnemar(arms[i], arms[j]).p for i in range(4) for j in range(i)]
        wrong += min(holm(p)) < 0.05
    assert wrong / 400 < 0.05


def test_the_number_of_pairs_gives_the_power_it_promises():
    p10, p01 = 0.15, 0.05
    n, rng = pairs_needed(p10 - p01, p10 + p01), stream(0, "power")
    assert n == 155  # Connor's formula by hand
    counts = rng.multinomial(n, [p10, p01, 1 - p10 - p01], size=1500)
    power = np.mean([mcnemar(*outcomes(b, c, 0)).p < 0.05 for b, c, _ in counts])
    assert 0.72 < power < 0.85  # exact is a little below the score test that the formula is for
    assert pairs_needed(0.05, 0.2) > 3.5 * n
    with pytest.raises(UserError):
        pairs_needed(0.0, 0.1)


def brute_mmrv(r, s):
    worst = [max(abs(r[i] - r[j]) * ((s[i] < s[j]) != (r[i] < r[j])) for j in range(len(r))) for i in range(len(r))]
    return sum(worst) / len(r)


def test_mmrv_of_counted_examples_and_against_the_definition():
    assert mmrv(np.array([0.1, 0.5, 0.9]), np.array([1, 2, 3])) == 0
    assert mmrv(np.array([0.1, 0.5, 0.9]), np.array([3, 2, 1])) == pytest.approx((0.8 + 0.4 + 0.8) / 3)
    assert mmrv(np.array([0.2, 0.6, 0.9]), np.array([0.5, 0.4, 0.9])) == pytest.approx((0.4 + 0.4) / 3)
    rng = stream(0, "mmrv")
    for _ in range(20):
        r, s = rng.integers(6, size=(2, 9)) / 5
        assert mmrv(r, s) == pytest.approx(brute_mmrv(r, s))
        assert mmrv(r, np.exp(3 * s)) == pytest.approx(mmrv(r, s))  # only the order of the predictor counts


def test_pearson_does_not_see_a_bias_and_the_mean_difference_does():
    y = np.linspace(0.1, 0.6, 10)
    found = predict(y + 0.3, y, stream(0, "bias"))
    assert found.pearson.value == pytest.approx(1) and found.spearman.value == pytest.approx(1)
    assert found.mmrv.value == 0 and found.mean_difference.value == pytest.approx(0.3) and found.enough


def test_correlations_are_scipys_with_ties():
    rng = stream(0, "ties")
    x, y = rng.integers(5, size=(2, 12)) / 4
    found = predict(x, y, rng)
    assert found.pearson.value == pytest.approx(pearsonr(x, y)[0])
    assert found.spearman.value == pytest.approx(spearmanr(x, y)[0])


def test_equals_predict_nothing():
    found = predict(np.ones(9), np.linspace(0, 1, 9), stream(0, "flat"))
    assert np.isnan(found.pearson.value) and not found.enough
    assert not predict(np.arange(5.0), np.arange(5.0), stream(0, "few")).enough
    with pytest.raises(UserError, match="two or more"):
        predict(np.ones(1), np.ones(1), stream(0, "one"))
