"""Finds what a robot model is missing, and trains peg insertion that transfers."""

__version__ = "0.1.0"


def _enrol() -> None:
    """Makes `gymnasium.make("vispeg:PegInHole-v0")` work where gymnasium is installed; costs nothing where it is not."""
    import sys

    if "gymnasium" in sys.modules:  # `vispeg:` in an environment's id imports this package from within gymnasium
        from gymnasium.envs.registration import register, registry

        if "PegInHole-v0" not in registry:
            register(
                "PegInHole-v0",
                entry_point="vispeg.task.env:PegInHoleEnv",
                vector_entry_point="vispeg.task.vector:PegInHoleVec",
                disable_env_checker=True,
            )


_enrol()
