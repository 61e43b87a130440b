"""MuJoCo's instability warnings, held back where divergence is an answer of its own."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

# A C function that does nothing. In a Python function an interrupt from the keyboard would be raised, and an exception
# that leaves a callback of MuJoCo's ends the process.
NOTHING = ctypes.cast(ctypes.pythonapi.Py_IsInitialized, ctypes.CFUNCTYPE(None, ctypes.c_char_p))


@contextmanager
def quiet() -> Iterator[None]:
    """MuJoCo's instability warnings held back; the caller looks for divergence itself."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(NOTHING)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
