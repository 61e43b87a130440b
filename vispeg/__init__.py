"""Finds what a robot model is missing, and trains peg insertion that transfers."""

from gymnasium.envs.registration import register

__version__ = "0.1.0"

# `gymnasium.make("vispeg:PegInHole-v0")` imports this package and then looks in its own registry
register(
    "PegInHole-v0",
    entry_point="vispeg.task.env:PegInHoleEnv",
    vector_entry_point="vispeg.task.vector:PegInHoleVec",
    disable_env_checker=True,
)
