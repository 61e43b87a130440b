"""Sizes of what a policy sees, and the stack of its last observations and actions."""

from __future__ import annotations

import numpy as np

from vispeg.task.config import TaskConfig

TURN = 0.1  # rad, a unit of the turn that a policy sees
PRIVILEGED = 3 + 3 + 3 + 3 + 3 + 1 + 1 + 1 + 4  # see PegSimulation.observation


def turns(config: TaskConfig) -> bool:
    """Whether the policy moves any rotation."""
    return any(d.startswith("r") for d in config.dof)


def policy_size(config: TaskConfig) -> int:
    """Numbers in one observation of the policy: relative position, velocity, force, torque, last action.

    A policy that turns the flange also sees how it is turned from straight down, and how fast.
    """
    return 12 + len(config.dof) + 6 * turns(config)


class Stack:
    """The last `depth` observations (nsim, size), newest first; a row that begins repeats its first one."""

    def __init__(self, depth: int, nsim: int, size: int):
        self.values = np.zeros((depth, nsim, size))

    def fill(self, rows: np.ndarray, value: np.ndarray) -> None:
        """Rows begin anew with their `value` (nsim, size)."""
        self.values[:, rows] = value[rows]

    def push(self, value: np.ndarray) -> None:
        """One more observation (nsim, size) of every row."""
        self.values[1:] = self.values[:-1]
        self.values[0] = value

    def flat(self) -> np.ndarray:
        """(nsim, depth size)."""
        return np.swapaxes(self.values, 0, 1).reshape(self.values.shape[1], -1)
