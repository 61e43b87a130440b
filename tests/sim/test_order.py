"""Rollouts are of second order in the step: half of it leaves a quarter of the error, under every control mode."""

import numpy as np
import pytest
from loops import drive, iiwa_segment, pendulum

from vispeg.robots.model import load
from vispeg.sim.rollout import simulate
from vispeg.sim.segments.segment import EXTERNAL
from vispeg.worlds.world import World

ANGLE = 5e-5  # rad, twice the noise of the bench's encoders


@pytest.mark.parametrize("mode", ["position", "torque", "osc"])
def test_half_of_the_step_leaves_a_quarter_of_the_error(mode):
    """Under `torque` the observer pulls all the time: the arm's path and the reference are 10 mrad apart."""
    segment = iiwa_segment(mode, 2.0, seed=1)
    fine, half, whole = (simulate(load("iiwa14"), [World()], [segment], h_max=h)[0].q for h in (1.25e-4, 5e-4, 1e-3))
    error, smaller = np.abs(whole - fine).max(), np.abs(half - fine).max()
    assert error < ANGLE and error > 3.5 * smaller


def test_an_external_torque_acts_when_it_is_measured():
    """`I ddq = T cos(w t)` from rest: `q = T / (I w^2) (1 - cos(w t))`, also with ticks of 10 ms."""
    robot, tick, w = pendulum(0.0), 0.01, 2.0 * np.pi
    segment = drive(robot, "passive", seconds=2.0, rate=1.0 / tick)
    middle = (np.arange(segment.ticks) + 0.5) * tick
    segment.cache[EXTERNAL] = np.cos(w * middle)[:, None]
    q = simulate(robot, [World()], [segment], observer=False)[0].q[0, :, 0]
    inertia = 0.02 + 2.0 * 0.3**2  # kg m^2
    truth = (1.0 - np.cos(w * segment.time)) / (inertia * w**2)
    assert np.abs(q - truth).max() < 2e-3 * truth.max()
