"""A soft observer: keeps an open-loop (torque, passive) rollout near the measured motion, from which it would drift."""

from __future__ import annotations

import numpy as np

from vispeg.robots.model import RobotModel
from vispeg.sim.segments.along import inertia, once
from vispeg.sim.segments.rows import ByTick, Rows

OBSERVER = 8.0  # rad/s, natural frequency of the observer that holds an open-loop rollout near the measured motion


def observer_spring(robot: RobotModel, inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffness N m/rad and damping N m s/rad of the observer at joints of apparent `inertia` (..., nj).

    With a stiffness in proportion to inertia alone, half a newton metre would deflect a light wrist by a radian. Torque
    errors of a drive scale with its torque limit, so half of that limit per radian is added, up to a frequency of
    40 rad/s, with a damping ratio of 0.7.
    """
    limit = np.where(np.isfinite(robot.torque_limit), robot.torque_limit, 100.0)  # N m
    stiffness = np.minimum(0.5 * limit, (40.0**2) * inertia)
    return stiffness, 1.4 * np.sqrt(stiffness * inertia)


class Observer:
    """Observer torque `M (w^2 e + 2 w de) + K e + D de`.

    Here e is the measured minus the simulated angle, M the inertia along the measured motion, w the frequency OBSERVER,
    and K and D are those of `observer_spring`.

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
        """Return the holding torque (nsim, nj) N m at tick k for encoder readings q (rad) and dq (rad/s)."""
        e, de = self.reference[0][k] - q, self.reference[1][k] - dq
        return np.einsum("nij,nj->ni", self.mass[k], OBSERVER**2 * e + 2 * OBSERVER * de) + (
            self.spring[0] * e + self.spring[1] * de
        )
