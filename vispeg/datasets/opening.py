"""Open a dataset in any layout, recognized by its content: LeRobot's or BOP's."""

from __future__ import annotations

from pathlib import Path

from vispeg.core.paths import expanded
from vispeg.datasets.describe import INFO, is_bop
from vispeg.datasets.formats.read_bop import Bop
from vispeg.datasets.read import Dataset
from vispeg.formats.guard import is_file


def holds_dataset(folder: Path) -> bool:
    """Return whether a folder looks like a dataset in a layout that `open_dataset` reads."""
    return is_file(folder / INFO) or is_bop(folder)


def open_dataset(folder: str | Path) -> Dataset | Bop:
    """Open the dataset in a folder. Raises UserError: there is none, or it cannot be read."""
    path = expanded(folder)
    return Bop(path) if is_bop(path) else Dataset(path)
