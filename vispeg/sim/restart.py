"""Rows of a running batch that begin anew: their model fields."""

from __future__ import annotations

from typing import Any

import numpy as np


class RowFields:
    """Stands in for a batch while effects write a few rows: `expand(name)` is (nrow, ...), nominal until written."""

    def __init__(self, model: Any, nrow: int):
        self.model, self.nrow = model, nrow
        self.values: dict[str, np.ndarray] = {}

    def expand(self, name: str) -> np.ndarray:
        """Give a writable copy of the model's field, one a row."""
        if name not in self.values:
            owner = self.model.opt if name.startswith("opt.") else self.model
            value = np.asarray(getattr(owner, name.removeprefix("opt.")))
            self.values[name] = np.repeat(value[None], self.nrow, axis=0)
        return self.values[name]
