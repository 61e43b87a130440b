"""Compile functions of arrays by numba, each for one signature, and keep the machine code from run to run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba import types

OPTIONS: dict[str, Any] = {"error_model": "numpy"}  # what is divided by 0 is infinite, as in NumPy
FLAG, WHOLE, NUMBER = types.boolean, types.int64, types.float64
FLAGS, WHOLES = (types.Array(kind, 1, "A", readonly=True) for kind in (FLAG, WHOLE))
PLACES = types.Array(WHOLE, 2, "A", readonly=True)
# of any strides, read only
VECTOR, ROWS, BLOCKS = (types.Array(NUMBER, axes, "A", readonly=True) for axes in (1, 2, 3))


def to(kind: types.Array) -> types.Array:
    """Return the type of an array that a function writes to."""
    return kind.copy(readonly=False)


def compiled(*arguments: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Compile a function for arguments of these types, when it is defined.

    The machine code is kept beside the source, else in the user's folder of numba (`NUMBA_CACHE_DIR` names another).
    Where none of these can be written, each process compiles for itself.
    """

    def compile(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(arguments, cache=True, **OPTIONS)(function)
        except (RuntimeError, OSError):  # no folder can be written, or its disk is full
            return numba.njit(arguments, **OPTIONS)(function)

    return compile


def inner(function: Callable[..., Any]) -> Any:
    """Mark a function that only compiled functions of its own file call: it becomes a part of them."""
    return numba.njit(**OPTIONS)(function)
