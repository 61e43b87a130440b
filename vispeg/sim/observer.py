"""A soft observer: keeps an open-loop (torque, passive) rollout near the measured motion, from which it would drift."""

from __future__ import annotations

import numpy as np

from vispeg.robots.model import RobotModel
from vispeg.sim.segments.along import inertia, once
from vispeg.sim.segments.rows import ByTick, Rows

OBSERVER = 8.0  # rad/s: how softly an open-loop rollout is held to the measured motion


def observer_spring(robot: RobotModel, inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness N m/rad and damping N m s/rad that the observer adds at each joint of apparent `inertia` (..., nj).

    A light wrist held by its inertia alone would be thrown a radian off by half a newton metre; what a drive can be
    wrong by goes with its torque limit, so half of that a radian is added, and the damping that goes with it.
    """
    limit = np.where(np.isfinite(robot.torque_limit), robot.torque_limit, 100.0)
    stiffness = np.minimum(0.5 * limit, (40.0**2) * inertia)
    return stiffness, 1.4 * np.sqrt(stiffness * inertia)


class Observer:
    """`M (w^2 e + 2 w de) + K e + D de`, e the measured less the simulated angle, M the inertia along the motion.

    Args:
        robot: the nominal robot.
        rows: segments of the rollout.
        reference: measured angles and velocities by tick, (nsim, nj) rad and rad/s.
        apparent: (nsim, nj) apparent inertia, kg m^2.
    """

    def __init__(self, robot: RobotModel, rows: Rows, reference: tuple[ByTick, ByTick], apparent: np.ndarray):
        self.reference = reference
        self.mass = rows.by_tick(lambda s: once(s, robot, inertia))
        self.spring = observer_spring(robot, apparent)

    def torque(self, k: int, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        """Give the holding torque (nsim, nj) N m at tick k for what the encoders read."""
        e, de = self.reference[0][k] - q, self.reference[1][k] - dq
        return np.einsum("nij,nj->ni", self.mass[k], OBSERVER**2 * e + 2 * OBSERVER * de) + (
            self.spring[0] * e + self.spring[1] * de
        )
