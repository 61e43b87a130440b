"""Gear play under a light rotor: a step short enough that the rotor does not run away between the teeth."""

import numpy as np
import pytest
from loops import iiwa_segment

from vispeg.core.effect import EffectInstance, effect
from vispeg.robots.model import load
from vispeg.sim.rollout import simulate
from vispeg.worlds.world import World

ROBOT = load("iiwa14")
PLAY = effect("backlash")


def test_the_step_is_a_share_of_the_time_in_which_the_rotor_turns_back():
    """One radian of its oscillation against the teeth takes sqrt(J c)."""
    for inertia in (1.0, 0.1, 0.014, 0.006):
        step = PLAY.stable_step({"motor_inertia": inertia, "compliance": 3e-5})
        assert step in (1e-3, 2.5e-4) or step <= 0.75 * np.sqrt(inertia * 3e-5)
    heavy, light = (PLAY.stable_step({"motor_inertia": i, "compliance": 3e-5}) for i in (0.4, 0.014))
    assert heavy == 1e-3 and light < heavy


@pytest.mark.slow
@pytest.mark.parametrize("gap", [3e-4, 6e-4])
def test_a_light_rotor_stays_between_its_teeth(gap):
    """At its step a wrist's play of half a milliradian stays near what a quarter of the step makes of it."""
    world = World().add(EffectInstance.of("backlash", "joint6", gap=gap, motor_inertia=0.014))
    segment = iiwa_segment("torque", 2.0, seed=1)
    step = PLAY.stable_step({"motor_inertia": 0.014, "compliance": 3e-5})
    coarse, fine = (simulate(ROBOT, [world], [segment], h_max=h)[0].q[0] for h in (step, step / 4))
    assert np.abs(coarse - fine).max() < 0.5 * gap
