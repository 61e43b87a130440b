"""Tests policies at hard positions, with and without pushes.

A push is 20 to 60 N for 0.2 s. Writes OUT/perturb.json and OUT/perturb.html: success with its interval at each
position, and what the pushes cost.

Example:
    vispeg perturb runs/{task}-state/best --world randomized --episodes 40 --out pushed
    vispeg perturb runs/{task}-depth/best --positions my-positions.yaml --force 20 40 --out pushed
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
    """Arguments of `vispeg perturb`."""

    policies: tyro.conf.Positional[tuple[str, ...]]
    """Policy folders, NAME=FOLDER, MODULE:CLASS, lerobot:FOLDER, .onnx or .zip files."""
    out: Path
    """Folder for the results."""
    world: str = "randomized"
    """A built-in world's name or a world file."""
    episodes: int = 40
    """Trials a position, and as many pushed ones."""
    force: tuple[float, float] = (20.0, 60.0)
    """Range of the pushes, N."""
    duration: float = 0.2
    """Duration of a push, s."""
    positions: Path | None = None
    """A file of positions, `format: vispeg-positions/1`; default: the task's."""
    tolerance: Room = None
    """Width of the goal less that of the part, mm; default: the world's."""
    trials: Played = Trials()

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints the table."""
        from vispeg.api.stress.perturb import perturb
        from vispeg.evaluation.entrants import entrants
        from vispeg.task.world_file import load_world

        result = perturb(
            self.policies,
            self.world,
            episodes=self.episodes,
            force=self.force,
            duration=self.duration,
            positions=self.positions,
            task=at_tolerance(entrants(self.policies), load_world(self.world), self.tolerance),
            **self.trials.options(self.out),
        )
        self.trials.give(result, self.out / result.page)
        return 0
