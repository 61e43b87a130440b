"""The GUM's own worked example, JCGM 101's, and what intervals promise, counted."""

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.measure.uncertainty import Input, coverage, effective, places, propagate, rectangular, repeated


def rng(seed=0):
    return np.random.default_rng(seed)


def test_end_gauge_calibration_of_the_gum():
    """JCGM 100:2008, H.1: u_c = 32 nm, 16 degrees of freedom, U_99 = 93 nm (k = 2.92), l = 50.000838 mm."""
    inputs = [
        Input("standard l_s", 50_000_623.0, 25.0, "B", 18.0, "t"),  # nm
        Input("comparison d", 215.0, 9.7, "A", 25.6, "t"),
        Input("expansion difference", 0.0, 0.58e-6, "B", 50.0, "t"),  # 1/deg C
        Input("temperature difference", 0.0, 0.029, "B", 2.0, "t"),  # deg C
    ]
    theta, alpha, length = -0.1, 11.5e-6, 50_000_623.0
    result = propagate("l", "nm", lambda s, d, da, dt: s + d - length * (da * theta + alpha * dt), inputs, rng())
    assert result.value == pytest.approx(50_000_838.0)
    assert result.u == pytest.approx(32.0, abs=0.5)
    assert int(result.dof) == 16
    assert coverage(16, 0.99) * 32 == pytest.approx(93.0, abs=0.5)
    assert [round(row.contribution, 1) for row in result.budget] == [25.0, 9.7, 2.9, 16.7]
    assert result.method == "gum"


@pytest.mark.parametrize(
    ("shape", "sizes", "end"),
    [
        ("normal", (1, 1, 1, 1), 3.92),  # JCGM 101:2008, 9.2.2
        ("rectangular", (1, 1, 1, 1), 3.88),  # 9.2.3
        ("rectangular", (1, 1, 1, 10), 17.0),  # 9.2.4
    ],
)
def test_additive_model_of_the_first_supplement(shape, sizes, end):
    drawn = sum(Input("x", 0.0, u, "B", np.inf, shape).draw(rng(i), 400_000) for i, u in enumerate(sizes))
    assert np.quantile(drawn, 0.975) == pytest.approx(end, abs=0.04)


def test_student_factors_of_the_gum():
    """JCGM 100:2008, table G.2, 95 %."""
    assert [round(coverage(dof), 2) for dof in (1, 2, 10, np.inf)] == [12.71, 4.30, 2.23, 1.96]


def test_one_source_keeps_its_own_degrees_of_freedom_and_equal_ones_add_them():
    mean = repeated("x", np.array([1.0, 2.0, 4.0, 5.0]))
    rows = propagate("x", "1", lambda x: x, [mean], rng()).budget
    assert effective(rows) == pytest.approx(3.0)
    rows = propagate("x", "1", lambda a, b: a + b, [mean, mean], rng()).budget
    assert effective(rows) == pytest.approx(6.0)


@pytest.mark.parametrize("readings", [3, 10])
def test_nineteen_of_twenty_intervals_of_a_mean_hold(readings):
    held = 0
    for seed in range(1500):
        x = repeated("x", 7.0 + 0.3 * rng(seed).standard_normal(readings))
        q = propagate("x", "1", lambda x: x, [x], rng())
        held += q.low <= 7.0 <= q.high
    assert held / 1500 == pytest.approx(0.95, abs=0.02)


def test_nineteen_of_twenty_hold_where_places_differ():
    held, narrow = 0, 0
    place = np.repeat([1.0, 2.0, 3.0], 4)
    for seed in range(1500):
        r = rng(seed)
        x = 7.0 + np.repeat(0.5 * r.standard_normal(3), 4) + 0.1 * r.standard_normal(12)
        for one, counts in ((places("x", x, place), True), (repeated("x", x), False)):
            q = propagate("x", "1", lambda x: x, [one], r)
            held += counts and q.low <= 7.0 <= q.high
            narrow += not counts and q.low <= 7.0 <= q.high
    assert held / 1500 == pytest.approx(0.95, abs=0.02)
    assert narrow / 1500 < 0.75  # what taking the repeats for independent would have promised


def test_a_bent_function_gets_its_interval_from_distributions():
    """The square of a Gaussian about 0 is chi-squared with one degree of freedom; its linear form has no width."""
    q = propagate("x2", "1", lambda x: x**2, [Input("x", 0.0, 1.0, "B"), Input("o", 0.0, 1e-3, "B")][:1], rng())
    assert q.u == 0 and q.method == "gum"  # nothing linear is left: said by u = 0
    q = propagate("x2", "1", lambda x: x**2, [Input("x", 1.0, 1.0, "B")], rng())
    assert q.method == "monte carlo"
    from scipy.stats import ncx2

    assert [q.low, q.high] == pytest.approx(ncx2.ppf([0.025, 0.975], 1, 1.0), abs=0.05)


def test_a_straight_function_keeps_the_closed_form():
    q = propagate("y", "1", lambda a, b: 2 * a - b, [Input("a", 1.0, 0.1, "B"), rectangular("b", 0.3)], rng())
    assert (q.method, q.u) == ("gum", pytest.approx(np.hypot(0.2, 0.3 / np.sqrt(3))))
    assert q.high - q.value == pytest.approx(1.959964 * q.u)


def test_one_value_alone_has_no_spread():
    with pytest.raises(UserError, match="one value alone"):
        repeated("x", np.array([1.0]))
