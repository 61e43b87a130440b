"""Simulate without MuJoCo's instability warnings and without its profiler."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

# The callback is a C function that does nothing. In a Python callback a keyboard interrupt could be raised, and an
# exception that leaves a MuJoCo callback ends the process.
NOTHING = ctypes.cast(ctypes.pythonapi.Py_IsInitialized, ctypes.CFUNCTYPE(None, ctypes.c_char_p))
# A C function that always returns the same number. MuJoCo reads its clock some thirty times in a step, for
# mjData.timer; that takes 7 % of a step of a cell and 20 % of a small arm's dynamics.
STOPPED = ctypes.cast(ctypes.pythonapi.PyFloat_GetMin, ctypes.CFUNCTYPE(ctypes.c_double))


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress MuJoCo's instability warnings, for a caller that checks for divergence itself, and stop its profiler."""
    warning, clock = mujoco.get_mju_user_warning(), mujoco.get_mjcb_time()  # None is MuJoCo's own
    mujoco.set_mju_user_warning(NOTHING)
    mujoco.set_mjcb_time(STOPPED)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(warning)
        mujoco.set_mjcb_time(clock)
