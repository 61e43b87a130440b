"""Derivatives of a sine against their closed form; what must not leak across gaps and episodes."""

from __future__ import annotations

import numpy as np
import pytest

from vispeg.recordings.differentiate import bridged, episodes, smooth

RATE = 500.0


def sine(time, hz):
    w = 2 * np.pi * hz
    return np.sin(w * time), w * np.cos(w * time), -(w**2) * np.sin(w * time)


@pytest.mark.parametrize("jitter", [0.0, 4e-4])
def test_a_sine_keeps_size_and_phase_up_to_its_edges(jitter):
    time = np.arange(0, 10, 1 / RATE)
    time = time + np.random.default_rng(0).uniform(-jitter, jitter, time.size)
    truth = [np.stack([a, b], 1) for a, b in zip(sine(time, 0.3), sine(time, 2.0), strict=True)]
    w = 2 * np.pi * np.array([0.3, 2.0])
    for order, (got, want) in enumerate(zip(smooth(time, truth[0], 20.0), truth, strict=True)):
        error = np.abs(got - want) / w**order
        assert error[100:-100].max() < 1e-6  # in the middle the filter's gain at 2 Hz is 1 - 1e-8
        assert error.max() < [1e-4, 2e-3, 3e-2][order]  # at the edges the curvature is unknown


def test_the_gain_at_the_cutoff_is_one_half_and_phase_is_zero():
    time = np.arange(0, 4, 1 / RATE)
    q = np.sin(2 * np.pi * 20 * time)[:, None]
    middle = slice(500, -500)
    got = smooth(time, q, 20.0)[0][middle, 0]
    gain = got @ q[middle, 0] / (q[middle, 0] @ q[middle, 0])
    assert gain == pytest.approx(0.5, abs=1e-3)
    assert np.abs(got - gain * q[middle, 0]).max() < 1e-3


def test_noise_on_velocity_falls_as_the_filter_says():
    time = np.arange(0, 40, 1 / RATE)
    noise = np.random.default_rng(1).normal(scale=1e-4, size=(time.size, 1))
    f = np.linspace(0, RATE / 2, 20001)
    power = np.mean((2 * np.pi * f) ** 2 / (1 + (f / 20.0) ** 8) ** 2)  # white noise through |H|^2, H = 1/(1+(f/fc)^8)
    assert smooth(time, noise, 20.0)[1].std() == pytest.approx(1e-4 * np.sqrt(power), rel=0.05)


def test_straight_lines_are_exact_however_short():
    for n in range(2, 40):
        time = np.arange(n) / RATE
        _, dq, ddq = smooth(time, 0.3 + 2.0 * time[:, None], 20.0)
        assert np.allclose(dq, 2.0, atol=1e-5) and np.allclose(ddq, 0.0, atol=1e-2)


def test_short_gaps_are_bridged_and_long_ones_stay():
    time = np.arange(0, 4, 1 / RATE)
    q, dq, _ = (x[:, None].repeat(2, 1) for x in sine(time, 1.0))
    holed = q.copy()
    holed[500:509, 0] = np.nan  # 20 ms between the readings on either side
    holed[1000:1050, 0] = np.nan
    _, got, _ = smooth(time, holed, 20.0)
    assert np.abs(got[480:530, 0] - dq[480:530, 0]).max() < 1e-3
    assert np.array_equal(np.isnan(got[:, 0]), np.isnan(holed[:, 0]) & (np.arange(time.size) >= 1000))
    assert np.array_equal(got[:, 1], smooth(time, q, 20.0)[1][:, 1])  # the other joint is not touched


def test_episodes_do_not_see_each_other():
    time = np.arange(0, 2, 1 / RATE)
    a, b = sine(time, 1.0)[0][:, None], 3.0 + sine(time, 0.4)[0][:, None]
    both, number = np.vstack([a, b]), np.repeat([0, 1], len(time))
    parted = smooth(np.tile(time, 2), both, 20.0)
    on = smooth(np.arange(2 * len(time)) / RATE, both, 20.0, number)  # the clock runs on: the number tells them apart
    for got, other, one, two in zip(parted, on, smooth(time, a, 20.0), smooth(time, b, 20.0), strict=True):
        assert np.array_equal(got, np.vstack([one, two])) and np.allclose(other, got, atol=1e-6)
    both[len(time) - 5 : len(time) + 5] = np.nan
    filled = bridged(np.arange(2 * len(time)) / RATE, both, number)
    assert np.array_equal(filled, bridged(np.tile(time, 2), both))


def test_the_callers_arrays_are_left_alone():
    time = np.arange(100) / RATE
    q = np.random.default_rng(2).normal(size=(100, 2))
    q[5] = np.nan
    before = time.copy(), q.copy()
    smooth(time, q, 20.0)
    assert np.array_equal(time, before[0]) and np.array_equal(q, before[1], equal_nan=True)


def test_a_clock_in_a_wrong_unit_or_in_bursts_costs_no_memory():
    """A filter's extension and an even grid are bounded by the samples there are, whatever their times say."""
    import tracemalloc

    n = 5000
    bursts = np.cumsum(np.tile([1e-9] * 9 + [0.018], n // 10))  # nine of ten rows arrive at once
    for time in (np.arange(n) * 2e-9, bursts):
        tracemalloc.start()
        q, _, _ = smooth(time, np.sin(time / time[-1])[:, None], 8.0)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 100e6 and np.isfinite(q).all()
    assert np.allclose(q[:, 0], np.sin(time / time[-1]), atol=0.01)


def test_a_clock_is_split_where_it_steps_back_and_not_where_a_row_repeats_its_time():
    time = np.array([0.0, 0.1, 0.1, 0.2, 0.0, 0.1])
    assert [rows.tolist() for rows in episodes(time)] == [[0, 1, 2, 3], [4, 5]]
    assert [rows.tolist() for rows in episodes(time, np.array([3, 3, 7, 7, 7, 7]))] == [[0, 1], [2, 3], [4, 5]]
