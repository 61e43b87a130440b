"""Torque noise has the size and the memory that it states, whatever the step."""

import numpy as np
import pytest

from vispeg.core.effect import effect
from vispeg.sim.state import DriveState

RMS, TIME = 0.7, 0.08


def played(h: float, seconds: float, seeds: list[float]) -> np.ndarray:
    """(n, nsim, 1) N m."""
    kind, n = effect("torque_noise"), len(seeds)
    p = {"rms": np.full((n, 1), RMS), "time": np.full((n, 1), TIME), "seed": np.array(seeds)[:, None]}
    still = np.zeros((n, 1))
    x = DriveState(h, h, still, still, still, still, np.ones((n, 1)))
    state = kind.start(x, p)
    return np.array([kind.torque(state, x, p) for _ in range(round(seconds / h))])


@pytest.mark.parametrize("h", [2e-3, 1e-2])
def test_its_size_and_its_memory_are_those_stated(h):
    tau = played(h, 40.0, [1.0, 2.0, 3.0, 4.0])[:, :, 0]
    assert tau.std() == pytest.approx(RMS, rel=0.1) and abs(tau.mean()) < 0.1 * RMS
    lag = round(TIME / h)
    alike = np.mean(tau[lag:] * tau[:-lag]) / np.mean(tau**2)
    assert alike == pytest.approx(np.exp(-1.0), abs=0.06)
    assert tau[0].std() > 0.1 * RMS, "stationary from the first step"


def test_a_row_draws_its_own_numbers_in_any_batch():
    alone, beside = played(5e-3, 1.0, [7.0]), played(5e-3, 1.0, [3.0, 7.0])
    np.testing.assert_array_equal(alone[:, 0], beside[:, 1])
    assert np.abs(beside[:, 0] - beside[:, 1]).max() > 0.1
