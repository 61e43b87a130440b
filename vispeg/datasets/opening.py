"""Open a dataset in any layout, recognized by its content: LeRobot's or BOP's."""

from __future__ import annotations

from pathlib import Path

from vispeg.datasets.describe import INFO
from vispeg.datasets.formats.read_bop import CAMERA, Bop
from vispeg.datasets.read import Dataset
from vispeg.formats.guard import is_file


def holds_dataset(folder: Path) -> bool:
    """Return whether a folder looks like a dataset in a layout that `open_dataset` reads."""
    return is_file(folder / INFO) or any(folder.glob(f"*/*/{CAMERA}"))


def open_dataset(folder: str | Path) -> Dataset | Bop:
    """Open the dataset in a folder. Raises UserError: there is none, or it cannot be read."""
    path = Path(folder).expanduser()
    if not is_file(path / INFO) and any(path.glob(f"*/*/{CAMERA}")):
        return Bop(path)
    return Dataset(path)
