"""Guards of the arm: they end an episode if a joint is too fast or too near its limit, or the arm near a singularity.

A real robot's controller stops there. A policy that is trained without guards may learn to rely on such motions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vispeg.control.laws import singular
from vispeg.core.errors import UserError
from vispeg.robots.model import RobotModel

if TYPE_CHECKING:
    from vispeg.task.config import TaskConfig

VELOCITY, LIMIT, SINGULARITY = "joint velocity", "joint limit", "singularity"
CATEGORIES = (VELOCITY, LIMIT, SINGULARITY)


class Guards:
    """The guards of all rows. They use true joint angles and velocities.

    Args:
        config: its `guard_velocity`, `guard_limit` and `guard_singularity` are used; 0 switches a guard off.
        robot: the arm.
        nsim: number of rows.

    Attributes:
        stopped: for each row the category of the guard that ended its episode, else None.

    Raises:
        UserError: a velocity guard for an arm whose file states no velocity limits.
    """

    def __init__(self, config: TaskConfig, robot: RobotModel, nsim: int):
        self.velocity = config.guard_velocity * robot.velocity_limit if config.guard_velocity else None
        self.low, self.high = robot.range.T + np.array([[config.guard_limit], [-config.guard_limit]])
        self.limit, self.singularity = config.guard_limit > 0, config.guard_singularity
        self.on = self.velocity is not None or self.limit or self.singularity > 0
        self.stopped: list[str | None] = [None] * nsim
        if self.velocity is not None and not np.isfinite(self.velocity).any():
            expected = "robot.velocity_limit, rad/s a joint: the robot's file states none"
            raise UserError("a guard without limits", key="guard_velocity", expected=expected)

    def reset(self, rows: np.ndarray) -> None:
        """Forget what stopped these rows (indices), as their episodes begin."""
        for i in rows:
            self.stopped[i] = None

    def tick(self, q: np.ndarray, dq: np.ndarray) -> None:
        """Check velocities and joint limits at a control tick; the first guard to act decides the category.

        Args:
            q, dq: (nsim, nj) true joint angles and velocities, rad and rad/s.
        """
        if self.velocity is not None:
            self._stop(np.flatnonzero((np.abs(dq) > self.velocity).any(axis=1)), VELOCITY)
        if self.limit:
            self._stop(np.flatnonzero(((q < self.low) | (q > self.high)).any(axis=1)), LIMIT)

    def pose(self, jac: np.ndarray) -> None:
        """Check for singularities after a policy step, from the flange's Jacobian (nsim, 6, nj)."""
        if self.singularity > 0:
            fine = np.flatnonzero(np.isfinite(jac).all(axis=(1, 2)))  # the other rows have diverged
            self._stop(fine[singular(jac[fine]) < self.singularity], SINGULARITY)

    def _stop(self, rows: np.ndarray, category: str) -> None:
        for i in rows:
            self.stopped[i] = self.stopped[i] or category
