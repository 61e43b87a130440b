"""Export datasets to other layouts, by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from vispeg.datasets.check import check
from vispeg.datasets.example import write_dataset
from vispeg.datasets.formats.bop import write_bop
from vispeg.datasets.shards.rendering import Export
from vispeg.formats.format import enrol

EXPORTS: Mapping[str, Export] = {"bop": write_bop}


def _example(folder: Path) -> Path:
    """Write the example dataset in BOP's layout."""
    (new := folder / "bop").mkdir()
    with TemporaryDirectory() as place:
        write_bop(write_dataset(Path(place)), new)
    return new


enrol("BOP", _example, slow=True)(check)


def export(source: Path, out: Path, layout: Literal["bop"] = "bop", *, overwrite: bool = False) -> None:
    """Write a copy of a dataset in another layout.

    Args:
        source: folder of the dataset.
        out: the new folder.
        layout: BOP, which pose estimators read.
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
