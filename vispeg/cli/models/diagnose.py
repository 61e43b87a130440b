"""Names the physical effect that a model lacks, adds it, and shows the error fall on recordings that were not fitted.

Writes OUT/diagnosis.json, OUT/report.html and OUT/model.yaml (the model with what was found), and the next motion to
record. Exits 0 with a verdict: adequate, identified, ambiguous or unexplained. A diagnosis that was killed goes on
where it stood when the same command is given again: what it had worked out lies in OUT.part until it is done.

With --baseline, what changed since those recordings is sought: a payload, what a repair did. What the baseline lacks is
found first and stands in the model; `effects` is the difference.

With --policy, a policy then plays its cell with the identified model, and again with every value drawn from its
interval and the torque that stays unexplained played back: what is left costs so many points of success.

Recordings of a cell with joint torques, a wrench and pictures are looked at in three rooms, one after the other and
again where one has named what another has to know: one record, one page, a verdict of each room and one of all.

Example:
    vispeg diagnose iiwa14 --recording rig-a --recording rig-b --validate rig-c --out found
    vispeg diagnose iiwa14 --recording rig-a --recording rig-b --validate rig-c --policy runs/best --out found
    vispeg diagnose iiwa14 --baseline empty-a --baseline empty-b --recording loaded-a --validate loaded-b --out change
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from vispeg.cli.output import Output, Told
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
    baseline: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """A recording of the same robot as it was before; two or more, the last one is judged on."""
    policy: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A policy's folder, or `expert`, to say what the remainder costs it; give the flag once for each."""
    world: str = "nominal"
    """The cell that it plays in: a built-in world's name or a world file."""
    episodes: int = 100
    """Its episodes, with and without the remainder each."""
    rooms: tuple[Literal["joints", "contact", "pictures"], ...] = ()
    """Of a cell, where the cause is looked for; where not given, in all that the recordings have something for."""
    seconds: float = SECONDS
    """Of a longer recording, the windows that show the most, this long in all; 0 uses all of it."""
    seed: int = 0
    """Seed of whatever is drawn."""
    threads: int = 2
    """Threads of the simulation."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    output: Told = Output()

    @goes_on()
    def run(self) -> int:
        """Runs the diagnosis and writes its folder."""
        from vispeg.api.diagnose import diagnose
        from vispeg.api.inputs import model_files
        from vispeg.cli.progress import stages
        from vispeg.cli.reading import reading_bars
        from vispeg.core.files import reserved
        from vispeg.report.text.terminal import report_line

        inputs = (*model_files(self.model), *self.recording, *self.validate, *self.baseline)
        with reserved(self.out, self.overwrite, holds="diagnosis", inputs=inputs), stages(self.output.quiet) as say:
            options = {"seconds": self.seconds, "seed": self.seed, "threads": self.threads, "say": say}
            options |= {"policies": self.policy, "cell": self.world, "episodes": self.episodes}
            options["rooms"] = self.rooms
            part, reading = self.out.with_name(self.out.name + ".part"), reading_bars(self.output.quiet)
            sides = (self.recording, self.validate)
            result = diagnose(self.model, *sides, baseline=self.baseline, part=part, reading=reading, **options)
            result.save(self.out, overwrite=self.overwrite)
        self.output.give(result.record, [*result.summary, report_line(self.out)])
        return 0
