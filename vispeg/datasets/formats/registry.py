"""Export datasets to other layouts, by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from vispeg.datasets.check import check
from vispeg.datasets.example import write_dataset
from vispeg.datasets.formats.bop import write_bop
from vispeg.datasets.formats.plain import PLAIN, write_plain
from vispeg.datasets.shards.rendering import Export
from vispeg.formats.format import Example, enrol

EXPORTS: Mapping[str, Export] = {"bop": write_bop, "folder": write_plain}


def _as(layout: str) -> Example:
    """Return the function that writes the example dataset in a layout."""

    def example(folder: Path) -> Path:
        (new := folder / layout).mkdir()
        with TemporaryDirectory() as place:
            EXPORTS[layout](write_dataset(Path(place)), new)
        return new

    return example


enrol(PLAIN.name, _as("folder"), slow=True)(check)
enrol("BOP", _as("bop"), slow=True)(check)


def export(source: Path, out: Path, layout: Literal["bop", "folder"] = "bop", *, overwrite: bool = False) -> None:
    """Write a copy of a dataset in another layout.

    Args:
        source: folder of the dataset.
        out: the new folder.
        layout: BOP, or plain PNG and CSV files.
        overwrite: replace `out` if it exists.

    Raises:
        UserError: an unknown layout, a dataset that cannot be read, a folder that cannot be written.
    """
    from vispeg.core.errors import UserError
    from vispeg.core.files import new_folder

    if layout not in EXPORTS:
        raise UserError("unknown layout", got=layout, choices=EXPORTS)
    with new_folder(out, overwrite=overwrite, holds="dataset", inputs=(source,)) as folder:
        try:
            EXPORTS[layout](source, folder)
        except OSError as error:
            raise UserError(f"cannot be written: {error.strerror}", file=out) from error
