"""The physics step of a diagnosis is fine enough: an effect's rollout is off by less than the noise of an encoder."""

from itertools import product

import numpy as np
from loops import iiwa_segment

from vispeg.core.effect import EffectInstance, searchable
from vispeg.robots.model import load
from vispeg.sim.rollout import simulate
from vispeg.worlds.world import World

NOISE = 2e-5  # rad, of the iiwa's recordings


def test_no_effect_is_off_by_its_step_by_more_than_the_noise():
    """Steps eight times as short change a path by under 0.6 of it, so its square by a third of the floor at most.

    Rounded angles are left out: where the true angle crosses a count, it moves the reading by all of a count.
    """
    robot, segment, placed = load("iiwa14"), iiwa_segment(seconds=2.0), []
    for name, kind in searchable().items():
        if "angle" in kind.channels() and not kind.overrides("resolution"):
            targets = kind.targets(robot)
            where = "joint3" if "joint3" in targets else targets[0]
            placed.append(EffectInstance.of(name, where, **{k: p.start for k, p in kind.params.items()}))
    for joint, inertia in product(("joint1", "joint3", "joint7"), (5e-4, 0.01, 0.2)):  # lighter and heavier than links
        placed.append(EffectInstance.of("joint_elasticity", joint, compliance=5e-5, motor_inertia=inertia))
        if inertia > 0.005:
            placed.append(EffectInstance.of("backlash", joint, gap=6e-4, motor_inertia=5 * inertia))
    placed.append(EffectInstance.of("torque_speed_limit", "joint1", stall=30.0, no_load=2.0))
    worlds = [World(), *(World().add(e) for e in placed)]
    usual, fine = (simulate(robot, worlds, [segment], h_max=h)[0].q for h in (1e-3, 1.25e-4))
    errors = np.sqrt(np.mean((usual - usual[0] - fine + fine[0]) ** 2, axis=(1, 2)))
    off = {e.label: error for e, error in zip(placed, errors[1:], strict=True) if error > 0.6 * NOISE}
    assert len(placed) > 20 and not off
