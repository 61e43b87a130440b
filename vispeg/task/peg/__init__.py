"""The peg-in-hole task: its settings, observations, rewards and categories of failure."""

from gymnasium.envs.registration import register, registry

TASK, UNNAMED = "vispeg.task.peg.task:PegTask", True

if "PegInHole-v0" not in registry:
    register(
        "PegInHole-v0",
        entry_point="vispeg.task.peg.task:PegInHoleEnv",
        vector_entry_point="vispeg.task.peg.task:PegInHoleVec",
        disable_env_checker=True,
    )
