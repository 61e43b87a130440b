"""The policy's controller: it stays stable over every latency that the worlds draw."""

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance
from vispeg.task.environments.simulation import TaskSimulation
from vispeg.task.peg.config import PegConfig
from vispeg.worlds.world import World


@pytest.mark.parametrize("rotation,stable", [(400.0, True), (900.0, False)])
def test_latency_of_20_ms_leaves_the_arm_at_rest(rotation, stable):
    """A critically damped law crosses over near twice its natural frequency: 2 sqrt(400) = 40 rad/s, where 20 ms and
    half a control period lag by 0.9 rad, less than the law's phase margin atan(2 * 40 / 20) = 1.3 rad; 2 sqrt(900) =
    60 rad/s leaves none."""
    config = PegConfig(steps=20, stiffness=(300.0, rotation))
    world = World(effects=(EffectInstance.of("command_delay", "all", delay=0.02),))
    sim = TaskSimulation(world, config, 1)
    sim.reset(np.arange(1), [3])
    up = np.array([[0.0, 0.0, 0.1]])
    for action in [up, -up, *[np.zeros((1, 3))] * 11]:
        sim.step(action)
    speed = float(np.abs(sim.cell.x.dq).max())
    assert (speed < 0.01) == stable, f"{speed} rad/s"


def test_defaults_are_what_was_proven_stable():
    """The numbers of the test above."""
    assert PegConfig().stiffness == (300.0, 400.0)
