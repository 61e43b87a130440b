"""Goals become torques inside the robot: a position servo's loop, run at every physics step."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vispeg.effects.common.servo_loop import ServoLoop
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import nominal_of
from vispeg.sim.plant import Plant


class Servos:
    """The servos of all arms of a plant.

    Args:
        plant: made with `servo=True`, so that delays act on goals.
    """

    def __init__(self, plant: Plant):
        self.plant, nj = plant, len(plant.robot.joints)
        self.law = ServoLoop.ideal(plant.nsim, nj)
        for a in plant.loop.active:
            if a.effect.overrides("regulate"):
                a.effect.regulate(self.law, a.p)
        self.last: np.ndarray | None = None
        self.inertia = np.broadcast_to(reference_inertia(plant.robot), (plant.nsim, nj))

    def torque(self, goal: np.ndarray) -> np.ndarray:
        """Torque (nsim, nj) N m in the coming physics step for goals (nsim, nj) rad that were sent by now."""
        x, loop = self.plant.x, self.plant.loop
        self.last = self.law.torque(loop.goal(goal, x), *loop.feedback(x), self.inertia, self.last, x)
        return self.last


@lru_cache(maxsize=64)
def reference_inertia(robot: RobotModel) -> np.ndarray:
    """Apparent inertia 1 / (M^-1)_jj (nj,) kg m^2 of the nominal arm in the middle of its joints' ranges."""
    middle = np.where(np.isfinite(robot.range).all(axis=1, keepdims=True), robot.range, 0.0).mean(axis=1)
    return 1.0 / np.diagonal(np.linalg.inv(nominal_of(robot, 1).operational(middle[None])[0][0]))
