"""MuJoCo's instability warnings, held back where divergence is an answer of its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco


@contextmanager
def quiet() -> Iterator[None]:
    """MuJoCo's instability warnings held back; the caller looks for divergence itself."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
