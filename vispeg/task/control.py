"""The task's controller: operational space control, which holds the flange at a commanded pose like a spring."""

from __future__ import annotations

import math

import numpy as np

from vispeg.control.laws import away, hold_pose
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import nominal_of
from vispeg.task.config import TaskConfig

POSTURE = 20.0  # 1/s^2 (per unit of inertia), stiffness towards the home posture in the null space
DAMPING = 2 * math.sqrt(POSTURE)  # 1/s, critical damping of that


class PoseControl:
    """Khatib's operational space law with the nominal arm's model, for all rows at once.

    Args:
        robot: the model that the controller knows: arm, tool and held part.
        nsim: number of rows.
        config: its `stiffness` (damping is critical), `force_limit` and `avoid_limits` are used.
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
        self.force_limit, self.home = config.force_limit, home
        self.limit = robot.torque_limit  # (nj,) N m
        self.avoid, self.range = config.avoid_limits, robot.range

    def torque(self, q: np.ndarray, dq: np.ndarray, pos: np.ndarray, rot: np.ndarray) -> np.ndarray:
        """Return the joint torque (nsim, nj) N m, gravity included, that pulls the flange to a pose.

        Args:
            q, dq: (nsim, nj) measured joint angles and velocities, rad and rad/s.
            pos, rot: flange pose in the base, (nsim, 3) m and (nsim, 4) wxyz.
        """
        state = self.nominal.operational(q)
        *_, gravity = state
        pull = POSTURE * (self.home - q) - DAMPING * dq
        if self.avoid:
            pull += away(q, self.range, self.avoid)
        tau = hold_pose(state, dq, pos, rot, self.kp, self.kd, pull, self.force_limit)
        tau += gravity
        return np.minimum(np.maximum(tau, -self.limit), self.limit)
