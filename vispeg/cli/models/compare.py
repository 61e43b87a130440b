"""Compares a model with recordings, without a fit.

Shows how large the error is, at which joint, and when. Writes OUT/compare.json, OUT/evidence.npz and OUT/report.html.

Example:
    vispeg compare iiwa14 --recording rig-a --recording rig-b --out compared
    vispeg compare found/model.yaml --recording rig-d --out compared
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from vispeg.cli.output import Output, OutputOptions
from vispeg.recordings.windows import SECONDS


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg compare`."""

    model: tyro.conf.Positional[str]
    """A model file, a robot's name, or a path to an MJCF or URDF."""
    out: Path
    """Folder for the results."""
    recording: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Recordings to compare with."""
    channels: tuple[Literal["joints", "contact", "pictures"], ...] = ()
    """The evidence to compare; default: what `vispeg diagnose` looks in."""
    seconds: float = SECONDS
    """Of longer recordings, use the most informative windows, this many seconds in all; 0 uses everything."""
    threads: int = 2
    """Threads of the simulation."""
    rerun: Path | None = None
    """Write a file FILE.rrd for the Rerun viewer: measured and modelled arm, every joint over time."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Compare, write the folder, print the table."""
        from vispeg.api.compare import compare
        from vispeg.api.inputs import model_files
        from vispeg.cli.reading import reading_bars
        from vispeg.core.files import reserved
        from vispeg.report.evidence import EVIDENCE, load_evidence
        from vispeg.report.rrd.comparison import write_comparison
        from vispeg.report.rrd.stream import check_target
        from vispeg.report.text.terminal import report_line

        if self.rerun is not None:
            check_target(self.rerun, self.overwrite)
        inputs = (*model_files(self.model), *self.recording)
        with reserved(self.out, self.overwrite, holds="comparison", inputs=inputs):
            options = {"channels": self.channels, "seconds": self.seconds, "threads": self.threads}
            result = compare(self.model, self.recording, reading=reading_bars(self.output.quiet), **options)
            result.save(self.out, overwrite=self.overwrite)
        if self.rerun is not None:
            write_comparison(self.rerun, f"compare {self.model}", load_evidence(self.out / EVIDENCE))
        lines = [] if self.rerun is None else [f"rerun: {self.rerun}"]
        self.output.give(result.record, [*result.summary, report_line(self.out), *lines])
        return 0
