"""Suppress MuJoCo's instability warnings where divergence is an expected result."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

# The callback is a C function that does nothing. In a Python callback a keyboard interrupt could be raised, and an
# exception that leaves a MuJoCo callback ends the process.
NOTHING = ctypes.cast(ctypes.pythonapi.Py_IsInitialized, ctypes.CFUNCTYPE(None, ctypes.c_char_p))


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress MuJoCo's instability warnings; the caller checks for divergence itself."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(NOTHING)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
