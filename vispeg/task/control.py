"""The policy's controller: operational space control that holds the flange at a commanded pose, like a spring."""

from __future__ import annotations

import math

import numpy as np

from vispeg.control.laws import away, hold_pose
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import nominal_of
from vispeg.task.config import TaskConfig

POSTURE = 20.0  # 1/s^2 per unit inertia, pull towards the home posture in the null space
DAMPING = 2 * math.sqrt(POSTURE)  # 1/s


class PoseControl:
    """Khatib's law on the nominal arm, for all rows at once.

    Args:
        robot: what the controller knows: arm, tool, what the tool holds.
        nsim: rows.
        config: `stiffness` (damping is critical), `force_limit`, `avoid_limits`.
        home: (nj,) posture for the null space, rad.
        nthread: threads.
    """

    def __init__(
        self,
        robot: RobotModel,
        nsim: int,
        config: TaskConfig,
        home: np.ndarray,
        nthread: int,
    ):
        self.nominal = nominal_of(robot, nsim, nthread)
        self.kp = np.repeat(np.repeat(config.stiffness, 3)[None], nsim, axis=0)
        self.kd = 2 * np.sqrt(self.kp)
        self.force_limit, self.home, self.limit = config.force_limit, home, robot.torque_limit
        self.avoid, self.range = config.avoid_limits, robot.range
        self.least = -self.limit

    def torque(self, q: np.ndarray, dq: np.ndarray, pos: np.ndarray, rot: np.ndarray) -> np.ndarray:
        """Joint torque (nsim, nj) N m towards the flange pose pos (nsim, 3), rot (nsim, 4)."""
        state = self.nominal.operational(q)
        pull = POSTURE * (self.home - q) - DAMPING * dq
        if self.avoid:
            pull += away(q, self.range, self.avoid)
        tau = hold_pose(state, dq, pos, rot, self.kp, self.kd, pull, self.force_limit)
        tau += state[4]
        return np.minimum(np.maximum(tau, self.least), self.limit)
