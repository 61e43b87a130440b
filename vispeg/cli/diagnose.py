"""Names the physical effect that a model lacks, adds it, and shows the error fall on recordings that were not fitted.

Writes OUT/diagnosis.json, OUT/report.html and OUT/model.yaml (the model with what was found), and the next motion to
record. Exits 0 with a verdict: adequate, identified, ambiguous or unexplained. A diagnosis that was killed goes on
where it stood when the same command is given again: what it had worked out lies in OUT.part until it is done.

Example:
    vispeg diagnose iiwa14 --recording rig-a --recording rig-b --validate rig-c --out found
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from vispeg.core.interrupt import goes_on
from vispeg.recordings.windows import SECONDS


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg diagnose`."""

    model: tyro.conf.Positional[str]
    """A model file, a robot's name, or a path to an MJCF or URDF."""
    out: Path
    """Folder for the results."""
    recording: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """A recording to fit; give the flag once for each."""
    validate: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """A recording to judge on, never fitted; give the flag once for each."""
    seconds: float = SECONDS
    """Of a longer recording, the windows that show the most, this long in all; 0 uses all of it."""
    seed: int = 0
    """Seed of whatever is drawn."""
    threads: Annotated[int, tyro.conf.arg(help="Threads of the simulation.")] = 2
    overwrite: bool = False
    """Replace OUT if it is there."""
    quiet: bool = False
    """No progress, only the table."""

    @goes_on()
    def run(self) -> int:
        """Runs the diagnosis and writes its folder."""
        from vispeg.cli.inputs import read_inputs
        from vispeg.cli.progress import stages
        from vispeg.core.files import new_folder
        from vispeg.core.provenance import digest, provenance
        from vispeg.diagnosis.progress import Progress
        from vispeg.diagnosis.run import diagnose
        from vispeg.report.terminal import print_diagnosis
        from vispeg.report.write import write_diagnosis
        from vispeg.worlds.model_file import model_text

        world, fitted, held_out = read_inputs(self.model, self.recording, self.validate, seconds=self.seconds)
        inputs = [*self.recording, *self.validate]
        stamp = provenance(sys.argv, self.seed, inputs)
        content = [[stamp["inputs"][str(path)] for path in paths] for paths in (self.recording, self.validate)]
        robot = digest(world.robot) if Path(world.robot).is_file() else None
        key = [model_text(world), robot, content, self.seconds, self.seed, stamp["versions"]]
        part = self.out.with_name(self.out.name + ".part")
        read = (self.model, world.robot, *inputs)
        with new_folder(self.out, overwrite=self.overwrite, holds="diagnosis", inputs=read) as folder:
            progress = Progress(part / "progress.json", key)
            options = {"seed": self.seed, "nthread": self.threads, "progress": progress}
            with stages(self.quiet) as say:
                say("going on" if progress.resumed else "simulating")
                found = diagnose(world, fitted, held_out, say=say, **options)
            record = {**found.record, "provenance": stamp}
            write_diagnosis(folder, record, found.world, found.arrays)
        progress.remove()
        print_diagnosis(json.loads((self.out / "diagnosis.json").read_text()), self.out)
        return 0
