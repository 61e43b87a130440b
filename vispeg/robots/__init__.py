"""Robots, tools and cells as MuJoCo models."""

from contextlib import suppress

import mujoco

from vispeg.core.notes import note


def keep_quiet() -> None:
    """Turn MuJoCo's warnings into Python warnings in this process, so that MuJoCo writes no log file."""
    mujoco.set_mju_user_warning(_to_python)


def _to_python(message: str) -> None:
    with suppress(Warning):  # called from C, where no exception may be raised
        note(f"MuJoCo: {message}")


keep_quiet()
