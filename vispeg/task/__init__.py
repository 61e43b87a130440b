"""The contact task: a peg, a hole, an arm under operational space control, and what may differ between worlds."""

from gymnasium.envs.registration import register, registry

if "PegInHole-v0" not in registry:
    register(
        "PegInHole-v0",
        entry_point="vispeg.task.env:PegInHoleEnv",
        vector_entry_point="vispeg.task.vector:PegInHoleVec",
        disable_env_checker=True,
    )
