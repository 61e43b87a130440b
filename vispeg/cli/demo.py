"""Runs the main job on bundled recordings, in about three minutes.

Compares the nominal model with recordings of a simulated robot, names the effects that it hides, and writes a report.
Then renders a contact sheet of the randomized task as its cameras deliver it.

Example:
    vispeg demo
    vispeg demo --out demo --overwrite
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg demo`."""

    out: Path = Path("vispeg-demo")
    """Folder for the results."""
    seed: int = 0
    """Seed of everything random."""
    threads: int = 2
    """Threads of the simulation."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Run the demonstration; the table of falling error comes first."""
        from rich.console import Console

        from vispeg.api.demo import FITTED, HELD_OUT, Demonstration, demo
        from vispeg.core.files import reserved
        from vispeg.report.record import ROBOT, SHEET

        start = time.monotonic()
        console = Console(stderr=True, highlight=False, quiet=self.output.quiet)
        with reserved(self.out, self.overwrite, holds=Demonstration.holds), console.status("reading") as status:
            console.print(f"fitted: {', '.join(FITTED)}; held out: {', '.join(HELD_OUT)}")
            demonstration = demo(seed=self.seed, threads=self.threads, say=status.update)
            demonstration.save(self.out, overwrite=self.overwrite)
        if demonstration.problem:
            console.print(f"no pictures of the cell: {demonstration.problem}")
        pictures = (("the robot and its cell", ROBOT), ("what policies are trained on", SHEET))
        files = [f"{what}: {self.out / name}" for what, name in pictures if name in demonstration.pictures]
        report = f"report: {self.out / 'report.html'}  ({time.monotonic() - start:.0f} s)"
        self.output.give(demonstration.record, [*demonstration.summary, *files, report])
        return 0
