"""Names the physical effect that a model lacks, adds it, and shows the error fall on recordings that were not fitted.

Writes OUT/diagnosis.json, OUT/report.html and OUT/model.yaml (the model with what was found), and the next motion to
record. Exits 0 with a verdict: adequate, identified, ambiguous or unexplained. A diagnosis that was killed goes on
where it stood when the same command is given again: what it had worked out lies in OUT.part until it is done.

--baseline asks what changed since those recordings: a payload, the result of a repair. The effects that the model lacks
already in the baseline are found first and added to it; `effects` then holds the change alone.

--policy asks what the remaining error costs a policy: it is played with the identified model, and again with each value
drawn from its interval and the unexplained torque added. The difference is in points of success.

Recordings of a cell may hold joint torques, a wrench and pictures. Each is diagnosed in a room of its own (joints,
contact, pictures), again where another room has named an effect that it needs. One page has all verdicts.

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

from vispeg.cli.output import Output, OutputOptions
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
    """A policy's folder or name, or `expert`: says what the remaining error costs it; give the flag once for each."""
    world: str = "nominal"
    """World that the policy plays in: a built-in world's name or a world file."""
    episodes: int = 100
    """Episodes of the policy, as many with the remaining error as without."""
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
    output: OutputOptions = Output()

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
