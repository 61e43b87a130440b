"""Where a motion begins: exact for what it fits, at rest where it rests, better than any single reading."""

import numpy as np
import pytest

from vispeg.core.seeds import stream
from vispeg.sim.segments.segment import start_state

TIME = np.arange(500) * 2e-3
SIGMA = np.full(3, 2e-5)


def test_a_parabola_is_read_exactly():
    """Without noise, a parabola's value and slope at its beginning come back, also where readings are missing."""
    q = np.stack([0.3 + 0.5 * TIME - 2.0 * TIME**2, -1.0 + 0.0 * TIME, 0.2 * TIME], axis=1)
    q[::7, 0], q[0, 2] = np.nan, np.nan
    angle, speed = start_state(TIME + 7.0, q, SIGMA)
    np.testing.assert_allclose(angle, [0.3, -1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(speed, [0.5, 0.0, 0.2], atol=1e-9)


def test_an_arm_at_rest_begins_at_rest():
    """Over 200 draws; also where, after 0.05 s, it accelerates by 3 rad/s^2 at once."""
    rng = stream(0, "rest")
    leaves = 1.5 * np.maximum(TIME - 0.05, 0.0)[:, None] ** 2 * [1.0, -0.5, 0.0]
    for motion in (0.0, leaves):
        found = [start_state(TIME, motion + rng.normal(scale=2e-5, size=(500, 3)), SIGMA) for _ in range(200)]
        assert not np.any([speed for _, speed in found])
        assert np.std([angle for angle, _ in found]) < 1e-5


@pytest.mark.parametrize("slow", [0.003, 0.05])
def test_error_of_a_steady_speed_is_near_that_of_a_parabola(slow):
    """Over 200 draws: the slope of a parabola at its end is known to sqrt(192) sigma / (T sqrt n).

    That the roughness is estimated, not known, costs up to two thirds more.
    """
    rng, n, span = stream(0, "rest"), 151, 0.3
    q = slow * TIME[:, None] + np.zeros(3)
    found = [start_state(TIME, q + rng.normal(scale=2e-5, size=q.shape), SIGMA)[1] - slow for _ in range(200)]
    expected = np.sqrt(192) * 2e-5 / (span * np.sqrt(n))
    assert 0.9 * expected < np.std(found) < 1.67 * expected


def test_one_joint_at_its_turning_point_is_not_at_rest():
    """A swing that turns at the start accelerates; the others tell that the arm moves."""
    rng, w = stream(2, "turn"), 4 * np.pi
    q = 0.3 * np.sin(w * TIME[:, None] + [np.pi / 2, 0.0, 0.3]) + rng.normal(scale=2e-5, size=(500, 3))
    _, speed = start_state(TIME, q, SIGMA)
    assert np.abs(speed - 0.3 * w * np.cos([np.pi / 2, 0.0, 0.3])).max() < 1.5e-2


def test_a_fast_curve_leaves_few_readings_that_count():
    """On a 2 Hz swing of 0.3 rad, 3.8 rad/s fast."""
    rng, w = stream(1, "swing"), 4 * np.pi
    phase = np.array([0.0, 0.7, 2.0])
    q = 0.3 * np.sin(w * TIME[:, None] + phase) + rng.normal(scale=2e-5, size=(500, 3))
    angle, speed = start_state(TIME, q, SIGMA)
    assert np.abs(angle - 0.3 * np.sin(phase)).max() < 1e-4
    assert np.abs(speed - 0.3 * w * np.cos(phase)).max() < 1.5e-2
