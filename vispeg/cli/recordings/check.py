"""Checks recordings: clock, limits, noise, excitation, contact.

Also states which effects a recording can show. Camera frames: clock, light, depth, views, and which camera errors they
can show.

Wrench of a described sensor: time in each regime of contact, forces, speeds, and which effects of contact they can
show.

Exit code 0: the recordings can be used, with or without warnings; 2: one cannot, named in one line.

Example:
    vispeg check rig-a rig-b
    vispeg check rig-a slide-a --out checked
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.output import Output, OutputOptions
from vispeg.cli.reading import progress_bar, size_of


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg check`."""

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recording folders."""
    out: Path | None = None
    """Folder for report.html, check.json and a picture of each recording."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Print what was found, and write it if asked."""
        from vispeg.api.recording.check import check

        def watch(what: str, path: Path):
            return progress_bar(f"{what} {path}", size_of(path) if what == "reading" else 0, self.output.quiet)

        checks = check(self.recordings, out=self.out, overwrite=self.overwrite, watch=watch)
        self.output.give(checks.record, checks.summary)
        if self.out is not None:
            self.output.line(f"report: {self.out / 'report.html'}")
        return 0
