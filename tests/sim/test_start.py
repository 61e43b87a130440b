"""Where a motion begins: exact for what it fits, better than any single reading, and not fooled by a curve."""

import numpy as np

from vispeg.core.seeds import stream
from vispeg.sim.segments.segment import start_state

TIME = np.arange(500) * 2e-3
SIGMA = np.full(3, 2e-5)


def test_a_cubic_is_read_exactly():
    """Without noise, a cubic's value and slope at its beginning come back."""
    q = np.stack([0.3 + 0.5 * TIME - 2.0 * TIME**2 + TIME**3, -1.0 + 0.0 * TIME, 0.2 * TIME], axis=1)
    angle, speed = start_state(TIME + 7.0, q, SIGMA)
    np.testing.assert_allclose(angle, [0.3, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(speed, [0.5, 0.0, 0.2], atol=1e-10)


def test_error_is_what_a_cubic_over_the_longest_window_promises():
    """At rest, over 200 draws: velocity error of the slope of an endpoint, 10 sqrt(12) sigma / (T sqrt n), +-20 %."""
    rng, n, span = stream(0, "rest"), 301, 0.6
    found = [start_state(TIME, rng.normal(scale=2e-5, size=(500, 3)), SIGMA)[1] for _ in range(200)]
    expected = 10 * np.sqrt(12) * 2e-5 / (span * np.sqrt(n))
    assert 0.8 * expected < np.std(found) < 1.35 * expected  # now and then noise alone shortens the window


def test_a_fast_curve_shortens_the_window():
    """On a 2 Hz swing of 0.3 rad, 3.8 rad/s fast, even a cubic over 0.07 s is too stiff: a quintic takes over."""
    rng, w = stream(1, "swing"), 4 * np.pi
    phase = np.array([0.0, 0.7, 2.0])
    q = 0.3 * np.sin(w * TIME[:, None] + phase) + rng.normal(scale=2e-5, size=(500, 3))
    angle, speed = start_state(TIME, q, SIGMA)
    assert np.abs(angle - 0.3 * np.sin(phase)).max() < 1e-4
    assert np.abs(speed - 0.3 * w * np.cos(phase)).max() < 1.5e-2
