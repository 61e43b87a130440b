"""Compile functions of arrays with numba, each for one signature, and cache the machine code between runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba import types

OPTIONS: dict[str, Any] = {"error_model": "numpy"}  # a division by 0 gives inf or NaN, as in NumPy
FLAG, WHOLE, NUMBER = types.boolean, types.int64, types.float64
# read-only arrays of any strides: of flags and whole numbers, with 1 or 2 axes
FLAGS, WHOLES = (types.Array(kind, 1, "A", readonly=True) for kind in (FLAG, WHOLE))
PLACES = types.Array(WHOLE, 2, "A", readonly=True)
# of numbers, with 1, 2 and 3 axes
VECTOR, ROWS, BLOCKS = (types.Array(NUMBER, axes, "A", readonly=True) for axes in (1, 2, 3))


def to(kind: types.Array) -> types.Array:
    """Return the type of an array that a function may write to."""
    return kind.copy(readonly=False)


def compiled(*arguments: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that compiles a function for arguments of these types, at its definition.

    The machine code is cached beside the source, else in numba's folder for the user (or in `NUMBA_CACHE_DIR`). If none
    of these can be written, each process compiles anew.
    """

    def compile(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(arguments, cache=True, **OPTIONS)(function)
        except (RuntimeError, OSError):  # no folder can be written, or its disk is full
            return numba.njit(arguments, **OPTIONS)(function)

    return compile


def inner(function: Callable[..., Any]) -> Any:
    """Compile a function that only compiled functions of the same file call, as a part of these."""
    return numba.njit(**OPTIONS)(function)
