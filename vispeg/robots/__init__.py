"""Robots, tools and cells as MuJoCo models."""

from contextlib import suppress

import mujoco

from vispeg.core.notes import note


def keep_quiet() -> None:
    """MuJoCo's warnings become Python's in this process; no file is written."""
    mujoco.set_mju_user_warning(_told)


def _told(message: str) -> None:
    with suppress(Warning):  # called from C, where nothing may be raised
        note(f"MuJoCo: {message}")


keep_quiet()
