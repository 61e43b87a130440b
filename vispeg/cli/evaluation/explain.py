"""Explains why trials of a policy fail on a robot.

Every trial's start is played again in simulation, by the policy and by the trial's own actions, over all that the world
draws. What the policy saw is exchanged for simulation's, one sense at a time, to see which moves its action. Each
effect of a model file is judged as a cause by what it costs the policy from those starts; `vispeg diagnose` of a motion
in free air, or with pictures, names such effects. Writes OUT/explain.json and OUT/explain.html.

Example:
    vispeg explain trials --policy runs/{task}-state/best --world randomized --out why
    vispeg explain trials --policy runs/{task}-state/best --model diagnosis/model.yaml --apply --out why
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
            apply=self.apply,
            task=at_tolerance(entrants([self.policy]), load_world(self.world), self.tolerance),
            **self.trials.options(self.out),
        )
        self.trials.give(result, self.out / result.page)
        return 0
