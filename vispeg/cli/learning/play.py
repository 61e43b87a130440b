"""Plays a policy and writes a video of each episode: the cell, the policy's own view, and its estimate of the goal.

Example:
    vispeg play runs/{task}-depth/20261121-0900_s0/checkpoints/best --episodes 3 --out films
    vispeg play state-3mm --world P --seed 7 --rerun seed-7.rrd --out films
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.output import Output, OutputOptions
from vispeg.cli.tolerance import Room


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg play`."""

    policy: tyro.conf.Positional[Path]
    """A policy's folder, or the name of one that comes with the package (`depth-S`)."""
    out: Path | None = None
    """Folder of the videos; films/POLICY-WORLD where not given."""
    world: str | None = None
    """A built-in world or a world file; the one that the policy was trained in where not given."""
    tolerance: Room = None
    """How much wider the goal is than what goes into it, mm; where not given the world's, or the policy's own in
    the world it was trained in."""
    episodes: int = 3
    """How many episodes."""
    seed: int = 0
    """Seed of the first; the next ones count up."""
    rerun: Path | None = None
    """A file FILE.rrd for the Rerun viewer with the same episodes in 3D: forces, what the policy sees and estimates."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Plays and writes."""
        from vispeg.api.films import play

        result = play(
            self.policy,
            world=self.world,
            tolerance=self.tolerance,
            episodes=self.episodes,
            seed=self.seed,
            out=self.out,
            rerun=self.rerun,
            overwrite=self.overwrite,
            watch=lambda film: self.output.line(film.line),
        )
        self.output.give(result.record, [] if result.rerun is None else [f"rerun: {result.rerun}"])
        return 0
