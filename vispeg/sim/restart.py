"""Rows of a running batch that begin anew: their model fields, and the states that effects carry."""

from __future__ import annotations

from typing import Any

import numpy as np

from vispeg.effects._delay import DelayLine


class RowFields:
    """Stands in for a batch while effects write a few rows: `expand(name)` is (nrow, ...), nominal until written."""

    def __init__(self, model: Any, nrow: int):
        self.model, self.nrow = model, nrow
        self.values: dict[str, np.ndarray] = {}

    def expand(self, name: str) -> np.ndarray:
        """A writable copy of the model's field, one a row."""
        if name not in self.values:
            owner = self.model.opt if name.startswith("opt.") else self.model
            value = np.asarray(getattr(owner, name.removeprefix("opt.")))
            self.values[name] = np.repeat(value[None], self.nrow, axis=0)
        return self.values[name]


def merged(old: Any, new: Any, rows: np.ndarray) -> Any:
    """The effect state `old` with `rows` (indices) taken from `new`, a state that `start` made for all rows.

    States are None, arrays whose leading axis is the simulation, delay lines, or dicts and tuples of these.
    """
    if isinstance(old, dict):
        return {k: merged(v, new[k], rows) for k, v in old.items()}
    if isinstance(old, tuple):
        return tuple(merged(a, b, rows) for a, b in zip(old, new, strict=True))
    if isinstance(old, np.ndarray):
        old = old.copy()
        old[rows] = new[rows]
        return old
    if isinstance(old, DelayLine):
        old.forget(rows)
        return old
    if old is None:
        return new
    raise TypeError(f"an effect's state of type {type(old).__name__} cannot begin anew row by row")
