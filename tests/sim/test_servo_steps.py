"""Servos are stable at the step that is chosen for the arm, and loads are read at the tick."""

import numpy as np
import pytest
from loops import ARM, drive, one

from vispeg.robots.model import load
from vispeg.sim.servo import stable_step
from vispeg.worlds.world import World

LIGHT = ARM.replace('mass="2"', 'mass=".2"').replace("0.02 0.02 0.02", "2e-4 2e-4 2e-4")
LIGHT = LIGHT.replace('mass="1"', 'mass=".05"').replace("0.01 0.01 0.01", "2e-5 2e-5 2e-5")


@pytest.fixture(scope="module")
def light(tmp_path_factory):
    """Two light links, of which the upper one is moved by the lower one as much as by its own servo."""
    path = tmp_path_factory.mktemp("light") / "arm.xml"
    path.write_text(LIGHT)
    return load(path)


def chirped(robot):
    """Goals up to 12 Hz at a rate of 500 Hz: within twice the step that is stable."""
    time = np.arange(1000) / 500.0
    goal = np.stack([0.05 * np.sin(2 * np.pi * 3.0 * time**2), 0.03 * np.cos(2 * np.pi * 3.0 * time**2) - 0.03], axis=1)
    return drive(robot, "servo", command=goal, seconds=2.0, rate=500.0)


def test_the_ideal_servos_of_an_arm_whose_joints_move_each_other_are_stable(light):
    """The step was a half larger once; the arm then swung wildly, 0.5 rad off."""
    segment = chirped(light)
    chosen, fine = (one(light, World(), segment, h_max=h) for h in (1.0, 1e-4))
    assert 1e-3 < stable_step(light) < 2e-3
    np.testing.assert_allclose(chosen.q, fine.q, atol=2e-3)


def test_a_load_at_the_tick_converges_with_the_square_of_the_step(light):
    """Not that of half a step before, which is off by its rate times half a step."""
    segment = chirped(light)
    steps = (1.0, 2e-4, 5e-5)  # s; the first is the longest stable one
    coarse, finer, fine = (one(light, World(), segment, h_max=h).tau_motor[0, 20:] for h in steps)
    error = [np.sqrt(np.mean((r - fine) ** 2, axis=0)) / np.std(fine, axis=0) for r in (coarse, finer)]
    assert np.all(error[0] < 0.04) and np.all(error[1] < 0.002)


def test_a_load_is_that_under_the_goal_before_the_tick(light):
    """Goals that jump at 50 Hz: a servo is read before it is sent the next goal, so no jump is in its load."""
    time = np.arange(100) / 50.0
    goal = np.stack([0.2 * np.sin(2 * np.pi * time), np.where(time % 0.4 < 0.2, 0.0, 0.1)], axis=1)
    segment = drive(light, "servo", command=goal, seconds=2.0, rate=50.0)
    coarse, fine = (one(light, World(), segment, h_max=h).tau_motor[0, 5:] for h in (2e-4, 5e-5))
    np.testing.assert_allclose(coarse, fine, atol=0.02 * np.std(fine))
    later = goal.copy()
    later[60:] += 0.3  # from here on all is another motion; the load at the tick is not
    other = one(light, World(), drive(light, "servo", command=later, seconds=2.0, rate=50.0)).tau_motor[0]
    same = one(light, World(), segment).tau_motor[0]
    np.testing.assert_array_equal(other[:61], same[:61])
    assert np.any(other[61] != same[61])
