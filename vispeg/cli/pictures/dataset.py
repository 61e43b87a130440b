"""Shows, checks and converts rendered datasets.

Example:
    vispeg dataset show frames --out frames-page
    vispeg dataset check frames
    vispeg dataset export frames --format bop --out frames-bop
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vispeg.cli.options import subcommand
from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Show:
    """Writes a contact sheet and a page of looks, depth, labels and draws."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    out: Path | None = None
    """Folder of the page; default: DATASET-page."""
    tiles: int = 36
    """Frames on the contact sheet."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Write the page and say where."""
        from vispeg.report.dataset.build import write

        out = self.out or self.dataset.with_name(f"{self.dataset.resolve().name}-page")
        page = write(self.dataset, out, self.tiles, overwrite=self.overwrite)
        self.output.give({"page": str(page)}, [f"page: {page}"])
        return 0


@dataclass(frozen=True)
class Check:
    """Checks a dataset for damaged or contradictory records; exit code 2 if any."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Print what is wrong, a line each."""
        from vispeg.api.datasets import check_dataset
        from vispeg.cli.progress import checking

        with checking(self.output.quiet) as watch:
            checked = check_dataset(self.dataset, watch=watch)
        for line in checked.faults:
            print(f"vispeg: error: {line}", file=sys.stderr)
        self.output.give(checked.record, [] if checked.faults else checked.summary)
        return 2 if checked.faults else 0


@dataclass(frozen=True)
class Export:
    """Writes a dataset in another layout."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    out: Path
    """The new folder."""
    format: Literal["bop", "folder"] = "bop"
    """BOP, or plain PNG and CSV files."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Write it and say where."""
        from vispeg.datasets.formats.registry import export

        export(self.dataset, self.out, self.format, overwrite=self.overwrite)
        self.output.give({"dataset": str(self.out), "format": self.format}, [f"{self.format}: {self.out}"])
        return 0


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg dataset`."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Show, subcommand(Show)] | Annotated[Check, subcommand(Check)] | Annotated[Export, subcommand(Export)]
    ]

    def run(self) -> int:
        """Run the sub-command."""
        return self.command.run()
