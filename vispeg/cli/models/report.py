"""Builds the HTML report of a finished result again.

Example:
    vispeg report out/rig-a --overwrite
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg report`."""

    out: Positional[Path]
    """Folder that `vispeg diagnose`, `vispeg compare` or `vispeg fit` wrote."""
    overwrite: bool = False
    """Replace report.html if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Write OUT/report.html, print its path and the headline; 0 on success."""
        from vispeg.report.build import write_report
        from vispeg.report.record import load_record
        from vispeg.report.text import words

        path = write_report(self.out, overwrite=self.overwrite)
        values = load_record(self.out).values
        said = words.verdict(values) or words.fall(values)
        self.output.give({"report": str(path), "headline": said}, [said, str(path)])
        return 0
