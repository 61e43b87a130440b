"""Plays a policy and writes a video of each episode.

A video shows the cell, the policy's images, and its estimate of the goal.

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
    """A policy's folder, or a bundled policy's name (`depth-S`)."""
    out: Path | None = None
    """Folder of the videos; default: films/POLICY-WORLD."""
    world: str | None = None
    """A built-in world's name or a world file; default: the training world."""
    tolerance: Room = None
    """Width of the goal less that of the part, mm; default: the world's, or the policy's in its training world."""
    episodes: int = 3
    """Number of episodes."""
    seed: int = 0
    """Seed of the first episode; the next ones count up."""
    rerun: Path | None = None
    """Write a file FILE.rrd for the Rerun viewer: the episodes in 3D, forces, images, estimates."""
    overwrite: bool = False
    """Replace OUT if it exists."""
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
