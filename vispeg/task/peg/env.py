"""The peg task under its names in gymnasium: `PegInHole-v0`, single and as a vector environment."""

from __future__ import annotations

from vispeg.task.environments.env import TaskEnv
from vispeg.task.environments.vector import TaskVec


class PegInHoleVec(TaskVec):
    """`num_envs` peg-in-hole environments, stepped together; see TaskVec."""


class PegInHoleEnv(TaskEnv):
    """One peg-in-hole environment; see TaskEnv."""
