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

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Show:
    """Writes a contact sheet (contact-sheet.png) and a page (index.html): looks, depth, labels, drawn parameters."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    out: Path | None = None
    """Folder of the page; DATASET-page where not given."""
    tiles: int = 36
    """Frames on the contact sheet."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Writes the page and says where."""
        from vispeg.report.dataset.build import write

        out = self.out or self.dataset.with_name(f"{self.dataset.resolve().name}-page")
        page = write(self.dataset, out, self.tiles, overwrite=self.overwrite)
        self.output.give({"page": str(page)}, [f"page: {page}"])
        return 0


@dataclass(frozen=True)
class Check:
    """Finds records that are cut short, changed, repeated or contradictory; exits with 2 if there are any."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Prints what is wrong, a line each."""
        from vispeg.cli.progress import bars
        from vispeg.datasets.check import check
        from vispeg.datasets.opening import open_dataset

        data = open_dataset(self.dataset)
        with bars({"checking": len(data)}, "frames", self.output.quiet) as advance:
            faults = check(self.dataset, lambda frames: advance("checking", frames))
        for line in faults:
            print(f"vispeg: error: {line}", file=sys.stderr)
        if faults:
            self.output.give({"dataset": str(self.dataset), "wrong": faults}, [])
            return 2
        megabytes = sum(f.stat().st_size for f in data.folder.rglob("*") if f.is_file()) / 1e6
        many = f"{len(data.episodes)} episode" + "s" * (len(data.episodes) != 1)
        text = f"{self.dataset}: {len(data)} frames in {many}, {megabytes:.1f} MB, nothing wrong"
        sizes = {"frames": len(data), "episodes": len(data.episodes), "megabytes": round(megabytes, 1)}
        self.output.give({"dataset": str(self.dataset), **sizes, "wrong": []}, [text])
        return 0


@dataclass(frozen=True)
class Export:
    """Writes a dataset once more in another layout."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    out: Path
    """The new folder."""
    format: Literal["bop", "folder"] = "bop"
    """BOP, or plain PNG and CSV files."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Writes it and says where."""
        from vispeg.datasets.formats.registry import export

        export(self.dataset, self.out, self.format, overwrite=self.overwrite)
        self.output.give({"dataset": str(self.out), "format": self.format}, [f"{self.format}: {self.out}"])
        return 0


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg dataset`."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Show, tyro.conf.subcommand("show")]
        | Annotated[Check, tyro.conf.subcommand("check")]
        | Annotated[Export, tyro.conf.subcommand("export")]
    ]

    def run(self) -> int:
        """Runs the sub-command."""
        return self.command.run()
