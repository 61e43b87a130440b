"""Position servos: a loop inside the robot that converts goals to torques at every physics step."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.stats import qmc

from vispeg.effects.common.servo_loop import FAST, ServoLoop
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import nominal_of
from vispeg.sim.plant import Plant

POSTURES = 64  # number of postures over which the inertia is evaluated
# Largest share of a mode's velocity that the loops' damping may remove per physics step. `Plant` and `ServoLoop` are
# stable up to 1.17 in seven arms of 2 to 7 joints, in all pairs of postures and for damping ratios of 1 and 2.
DAMPED = 1.0


class Servos:
    """The servos of all arms of a plant.

    Args:
        plant: a plant with `servo=True`, so that delays act on goals.
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
        """Return the torque (nsim, nj) N m in the coming physics step for the latest goals (nsim, nj) rad."""
        x, loop = self.plant.x, self.plant.loop
        self.last = self.law.torque(loop.goal(goal, x), *loop.feedback(x), self.inertia, self.last, x)
        return self.last


@lru_cache(maxsize=64)
def reference_inertia(robot: RobotModel) -> np.ndarray:
    """Return the apparent inertia 1 / (M^-1)_jj (nj,) kg m^2 of the nominal arm, averaged over postures in its range.

    A single posture is not enough: in a stretched arm the apparent inertia of a middle joint nearly vanishes.
    """
    return np.mean(1.0 / np.diagonal(np.linalg.inv(_masses(robot)), axis1=1, axis2=2), axis=0)


@lru_cache(maxsize=64)
def stable_step(robot: RobotModel) -> float:
    """Return the greatest physics step, s, at which the arm under ideal servos is stable.

    Through inertial coupling, the arm's most damped mode loses velocity at max eig(M^-1 J) times the rate of a single
    servo's, 2 zeta w, and `ServoLoop.torque` knows each joint's own inertia alone.
    """
    modes = np.linalg.eigvals(np.linalg.solve(_masses(robot), np.diag(reference_inertia(robot))[None]))
    return DAMPED / (2.0 * FAST * float(np.max(modes.real)))


def _masses(robot: RobotModel) -> np.ndarray:
    """Compute the inertia (POSTURES, nj, nj) kg m^2 of the nominal arm in postures spread over its range."""
    low, high = np.where(np.isfinite(robot.range).all(axis=1, keepdims=True), robot.range, (-1.0, 1.0)).T
    postures = low + (high - low) * qmc.Halton(len(low), scramble=False).random(POSTURES)
    return nominal_of(robot, POSTURES).operational(postures)[0]
