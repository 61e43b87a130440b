"""Goals become torques inside the robot: a position servo's loop, run at every physics step."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.stats import qmc

from vispeg.effects.common.servo_loop import FAST, ServoLoop
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import nominal_of
from vispeg.sim.plant import Plant

POSTURES = 64
RESOLVED = 0.5  # rad of the fastest mode's phase in a step


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
    """Apparent inertia 1 / (M^-1)_jj (nj,) kg m^2 of the nominal arm, the mean over postures all over its ranges.

    One posture will not do: where an arm is stretched a joint in its middle hardly feels any inertia.
    """
    return np.mean(1.0 / np.diagonal(np.linalg.inv(_masses(robot)), axis1=1, axis2=2), axis=0)


@lru_cache(maxsize=64)
def stable_step(robot: RobotModel) -> float:
    """Greatest physics step, s, that resolves the fastest motion of the arm under ideal servos.

    Joints move each other: the arm's fastest mode is sqrt(max eig(M^-1 J)) times as fast as a servo alone.
    """
    modes = np.linalg.eigvals(np.linalg.solve(_masses(robot), np.diag(reference_inertia(robot))[None]))
    return RESOLVED / (FAST * float(np.sqrt(np.max(modes.real))))


def _masses(robot: RobotModel) -> np.ndarray:
    """Inertia (POSTURES, nj, nj) kg m^2 of the nominal arm in postures spread over its ranges."""
    low, high = np.where(np.isfinite(robot.range).all(axis=1, keepdims=True), robot.range, (-1.0, 1.0)).T
    postures = low + (high - low) * qmc.Halton(len(low), scramble=False).random(POSTURES)
    return nominal_of(robot, POSTURES).operational(postures)[0]
