"""The phase of a motion is the usual one for a sine, and every stroke runs evenly from turn to turn."""

import numpy as np
import pytest

from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.phase import phase

TIME = np.arange(4000) * 1e-3


def distance(a, b):
    """On the circle of circumference 1."""
    return np.abs((a - b + 0.5) % 1.0 - 0.5)


@pytest.mark.parametrize("amplitude", [0.02, 1.0])
def test_a_sine_has_its_usual_phase(amplitude):
    """A joint at -A cos(2 pi f t) stands at its lower turning point at t = 0, 1/f, ..."""
    f = np.array([1.0, 2.5])
    dq = amplitude * 2 * np.pi * f * np.sin(2 * np.pi * f * TIME[:, None])
    found = phase(TIME, dq)
    known = np.isfinite(found)
    assert np.all(distance(found, (f * TIME[:, None]) % 1.0)[known] < 2e-3)
    assert known[600:3400].all() and not known[:300, 0].any(), "the stroke before the first turn has no known length"
    assert found[known].min() >= 0 and found[known].max() <= 1


def test_strokes_of_any_shape_grow_evenly():
    """Speed +1 for 0.7 s, -2 for 0.5 s, +0.5 for 1.4 s, ...: the phase is linear in time from turn to turn."""
    ends = np.cumsum([0.4, 0.7, 0.5, 1.4, 0.6])
    dq = np.select([ends[i] > TIME for i in range(5)], [-1.0, 1.0, -2.0, 0.5, -1.0], 1.0)[:, None]
    found = phase(TIME, dq)[:, 0]
    for start, stop, at in zip(ends, ends[1:], (0.0, 0.5, 0.0, 0.5), strict=False):
        rows = (start + 5e-3 < TIME) & (stop - 5e-3 > TIME)
        wanted = at + 0.5 * (TIME[rows] - start) / (stop - start)
        np.testing.assert_allclose(found[rows], wanted, atol=5e-3)


def test_noise_is_no_reversal_of_motion():
    """A joint that rests between two strokes of one direction has not turned back; one at rest has no phase."""
    dq = np.where((TIME > 1.5) & (TIME < 2.5), 0.0, np.sin(2 * np.pi * TIME / 4 + 0.0))
    dq = np.stack([np.abs(dq), 0 * dq], axis=1) + 2e-3 * 0.3 * stream(0, "noise").standard_normal((4000, 2))
    assert np.isnan(phase(TIME, dq)[:, 0]).all(), "it only ever moves upward"
    assert np.isnan(phase(TIME, 0 * dq)).all()
