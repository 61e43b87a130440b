"""Names the effects that a model lacks and adds them to it.

An effect is accepted if the error falls on held-out recordings. Writes OUT/diagnosis.json, OUT/report.html,
OUT/model.yaml (the corrected model) and the next motion to record. Exits 0 with a verdict: adequate, identified,
ambiguous or unexplained. A diagnosis that was stopped goes on when the command is repeated; its steps are in OUT.part.

`--baseline`: what changed since those recordings, such as a payload or a repair? Effects that the model lacked before
are named first and added to it; `effects` then holds the change alone.

`--policy`: what does the remaining error cost a policy? It plays with the identified model, and again with each value
drawn from its interval and the unexplained torque added. The difference is in points of success.

Recordings may hold joint torques, pictures and, of a cell, a wrench. Each is diagnosed by itself (joints, contact,
pictures), again if another one has named an effect that it needs. One page has all verdicts. Pictures are held
against a cell, or against what the robot's own MJCF shows beside the arm.

Example:
    vispeg diagnose iiwa14 --recording rig-a rig-b --validate rig-c --out found
    vispeg diagnose iiwa14 --recording rig-a --hold-out 0.3 --out found
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
    """Recordings to fit."""
    validate: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Held-out recordings, never fitted."""
    hold_out: float | None = None
    """With one recording alone: judge on this share of it, its end; 0.3 is usual."""
    baseline: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """An earlier recording of the same robot; two or more, the last one is held out."""
    policy: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A policy's folder or name, or `expert`: state what the remaining error costs it; repeat the option for each."""
    world: str = "nominal"
    """World of the policy: a built-in world's name or a world file."""
    episodes: int = 100
    """Episodes of the policy, with and without the remaining error."""
    channels: tuple[Literal["joints", "contact", "pictures", "tosses"], ...] = ()
    """The evidence to diagnose; default: all that the recordings hold, in a cell the joints only beside both others."""
    rooms: tuple[Literal["joints", "contact", "pictures"], ...] = ()
    """What --channels was called; goes with the next release."""
    seconds: float = SECONDS
    """Of longer recordings, use the most informative windows, this many seconds in all; 0 uses everything."""
    seed: int = 0
    """Seed of everything random."""
    threads: int = 2
    """Threads of the simulation."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    @goes_on()
    def run(self) -> int:
        """Run the diagnosis and write its folder."""
        from vispeg.api.diagnose import diagnose
        from vispeg.api.inputs import model_files
        from vispeg.cli.progress import stages
        from vispeg.cli.reading import reading_bars
        from vispeg.core.files import reserved
        from vispeg.report.text.proposal import likely
        from vispeg.report.text.terminal import written_lines

        inputs = (*model_files(self.model), *self.recording, *self.validate, *self.baseline)
        with reserved(self.out, self.overwrite, holds="diagnosis", inputs=inputs), stages(self.output.quiet) as say:
            options = {"seconds": self.seconds, "seed": self.seed, "threads": self.threads, "say": say}
            options |= {"policies": self.policy, "cell": self.world, "episodes": self.episodes}
            options |= {"likely": lambda proposal: say.keep(likely(proposal))}
            options |= {"channels": self.channels, "rooms": self.rooms, "hold_out": self.hold_out}
            part, reading = self.out.with_name(self.out.name + ".part"), reading_bars(self.output.quiet)
            sides = (self.recording, self.validate)
            result = diagnose(self.model, *sides, baseline=self.baseline, part=part, reading=reading, **options)
            result.save(self.out, overwrite=self.overwrite)
        self.output.give(result.record, [*result.summary, *written_lines(result.record, self.out)])
        return 0
