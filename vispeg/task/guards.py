"""Guards of the arm: a joint too fast, a joint too near its limit, a singularity too near end an episode.

A robot's own controller stops it there; a policy that only ever met a forgiving simulation learns to rely on it.
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
    """What stops the arm, for all rows at once. It looks at true joint angles, at every control tick.

    Args:
        config: `guard_velocity`, `guard_limit`, `guard_singularity`; 0 each for a guard that is off.
        robot: the arm.
        nsim: rows.

    Raises:
        UserError: a guard of velocities, and an arm whose limits nobody stated.
    """

    def __init__(self, config: TaskConfig, robot: RobotModel, nsim: int):
        self.velocity = config.guard_velocity * robot.velocity_limit if config.guard_velocity else None
        self.low, self.high = robot.range.T + np.array([[config.guard_limit], [-config.guard_limit]])
        self.limit, self.least = config.guard_limit > 0, config.guard_singularity
        self.on = self.velocity is not None or self.limit or self.least > 0
        self.stopped: list[str | None] = [None] * nsim
        if self.velocity is not None and not np.isfinite(self.velocity).any():
            expected = "robot.velocity_limit, rad/s a joint: the robot's file states none"
            raise UserError("a guard without limits", key="guard_velocity", expected=expected)

    def reset(self, rows: np.ndarray) -> None:
        """Let these rows begin anew."""
        for i in rows:
            self.stopped[i] = None

    def tick(self, q: np.ndarray, dq: np.ndarray) -> None:
        """Angles (nsim, nj) rad and velocities (nsim, nj) rad/s at a control tick; the first guard to act counts."""
        if self.velocity is not None:
            self._stop(np.flatnonzero((np.abs(dq) > self.velocity).any(axis=1)), VELOCITY)
        if self.limit:
            self._stop(np.flatnonzero(((q < self.low) | (q > self.high)).any(axis=1)), LIMIT)

    def pose(self, jac: np.ndarray) -> None:
        """Give the flange's Jacobian (nsim, 6, nj) after a policy step."""
        if self.least > 0:
            fine = np.flatnonzero(np.isfinite(jac).all(axis=(1, 2)))  # the others diverge
            self._stop(fine[singular(jac[fine]) < self.least], SINGULARITY)

    def _stop(self, rows: np.ndarray, category: str) -> None:
        for i in rows:
            self.stopped[i] = self.stopped[i] or category
