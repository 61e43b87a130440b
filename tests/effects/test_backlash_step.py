"""Gear play at its step: what a sixteenth of the step makes of it."""

import numpy as np
import pytest
from loops import iiwa_segment

from vispeg.core.effect import EffectInstance, effect
from vispeg.robots.model import load
from vispeg.sim.rollout import simulate
from vispeg.worlds.world import World

ROBOT = load("iiwa14")
STEP = effect("backlash").stable_step({})


@pytest.mark.parametrize("mode", ["torque", "position"])
@pytest.mark.parametrize(
    ("joint", "gap", "inertia"),
    [("joint6", 3e-4, 0.014), ("joint6", 1e-3, 0.005), ("joint3", 1e-3, 0.03), ("joint1", 2e-3, 0.42)],
)
def test_a_rotor_stays_between_its_teeth(mode, joint, gap, inertia):
    """Within 0.3 gaps everywhere, and within 4 % of the effect (RMS)."""
    world = World().add(EffectInstance.of("backlash", joint, gap=gap, motor_inertia=inertia))
    segment = iiwa_segment(mode, 2.0, seed=1)
    coarse, fine = (simulate(ROBOT, [world], [segment], h_max=h)[0].q[0] for h in (STEP, STEP / 16))
    (bare,) = simulate(ROBOT, [World()], [segment], h_max=STEP)[0].q
    assert np.abs(coarse - fine).max() < 0.3 * gap
    assert np.sqrt(np.mean((coarse - fine) ** 2)) < 0.04 * np.sqrt(np.mean((bare - fine) ** 2))
