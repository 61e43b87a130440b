"""Explains why trials of a policy fail on a robot.

Every trial's start is played again in simulation, by the policy and by the trial's own actions, over all that the world
draws. What the policy saw is exchanged for simulation's, one sense at a time, to see which moves its action. Each
effect of a model file is judged as a cause by what it costs the policy from those starts; `vispeg diagnose` of a motion
in free air, or with pictures, names such effects. `--remainder` plays what none of them explains, and says whether the
gap is unbridgeable here; next steps stand with what they win back at most, and their hours. Writes OUT/explain.json and
OUT/explain.html.

Example:
    vispeg explain trials --policy runs/{task}-state/best --world randomized --out why
    vispeg explain trials --policy runs/{task}-state/best --model diagnosis/model.yaml --apply --out why
    vispeg explain trials --policy runs/{task}-state/best --model diagnosis/model.yaml --remainder 200 --out why
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.evaluation.trials import Played, Trials
from vispeg.cli.tolerance import Room, at_tolerance
from vispeg.core.interrupt import goes_on


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg explain`."""

    place: tyro.conf.Positional[Path]
    """A folder of trials."""
    policy: str
    """Whose trials they are: a folder, or a bundled policy's name."""
    out: Path
    """Folder for the result."""
    world: str = "nominal"
    """The simulated world: a built-in world's name or a world file. What it draws is the model's uncertainty."""
    model: Path | None = None
    """A model file whose effects may be the causes. Default: no cause is tried."""
    replays: int = 20
    """Replays of each start."""
    remainder: int = 0
    """Episodes that play the torque which the trials' motions lack in the found world, and as many without; again where
    the policy was trained. 200 tell 5 points."""
    held_out: tuple[Path, ...] = ()
    """Recordings that this torque is taken from. Default: the trials."""
    demonstrations: int = 50
    """How many would be recorded on the robot, for their price."""
    minutes_per_demonstration: float = 1.0
    """What setting up and doing one takes you, min; 500 in a day of eight hours."""
    minutes_per_recording: float = 17.0
    """What setting up a motion for `diagnose` takes you, min; two hours for an arm of seven joints."""
    training_hours: float | None = None
    """Of fine-tuning; default: as the log of the policy's own training says, where there is one."""
    apply: bool = False
    """Write OUT/world.yaml, which has the causes, and print the command that trains in it; or the one that collects
    demonstrations from where the policy fails."""
    tolerance: Room = None
    """Width of the goal less that of the part, mm; default: the world's."""
    trials: Played = Trials()

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints the verdict and the causes."""
        from vispeg.api.explain import explain
        from vispeg.evaluation.entrants import entrants
        from vispeg.task.world_file import load_world

        result = explain(
            self.place,
            self.policy,
            self.world,
            model=self.model,
            replays=self.replays,
            remainder=self.remainder,
            held_out=self.held_out,
            demonstrations=self.demonstrations,
            minutes_per_demonstration=self.minutes_per_demonstration,
            minutes_per_recording=self.minutes_per_recording,
            training_hours=self.training_hours,
            apply=self.apply,
            task=at_tolerance(entrants([self.policy]), load_world(self.world), self.tolerance),
            **self.trials.options(self.out),
        )
        self.trials.give(result, self.out / result.page)
        return 0
