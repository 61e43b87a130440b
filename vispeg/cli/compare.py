"""Compares a model with recordings, without fitting anything: how far off it is, at which joint, and when.

Writes OUT/compare.json, OUT/evidence.npz and OUT/report.html.

Example:
    vispeg compare iiwa14 --recording rig-a --recording rig-b --out compared
    vispeg compare found/model.yaml --recording rig-d --out compared
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.recordings.windows import SECONDS


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg compare`."""

    model: tyro.conf.Positional[str]
    """A model file, a robot's name, or a path to an MJCF or URDF."""
    out: Path
    """Folder for the results."""
    recording: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """A recording to compare with; give the flag once for each."""
    seconds: float = SECONDS
    """Of a longer recording, the windows that show the most, this long in all; 0 uses all of it."""
    threads: int = 2
    """Threads of the simulation."""
    overwrite: bool = False
    """Replace OUT if it is there."""

    def run(self) -> int:
        """Compares, writes the folder, prints the table."""
        from vispeg.cli.inputs import read_inputs
        from vispeg.core.files import new_folder
        from vispeg.core.provenance import provenance
        from vispeg.diagnosis.compare import compare
        from vispeg.report.terminal import print_comparison
        from vispeg.report.write import write_comparison

        world, recordings, _ = read_inputs(self.model, self.recording, (), False, self.seconds)
        inputs = (self.model, world.robot, *self.recording)
        with new_folder(self.out, overwrite=self.overwrite, holds="comparison", inputs=inputs) as folder:
            found = compare(world, recordings, nthread=self.threads)
            record = {**found.record, "provenance": provenance(sys.argv, None, self.recording)}
            write_comparison(folder, record, found.arrays)
        print_comparison(record, self.out)
        return 0
