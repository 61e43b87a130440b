"""Renders a dataset of the peg task: an expert plays, and its moments are drawn in several looks through the cameras.

The folder is laid out as LeRobotDataset v3.0 (or for BOP, or as plain files). A rendering that was stopped goes on when
the same command is given again, and ends with the same bytes; until then it lives in OUT.unfinished. The bytes depend
neither on the number of workers nor on the engine. See docs/datasets.md.

Example:
    vispeg render --world S --frames 2000 --out frames
    vispeg render --world S --frames 2000 --looks 4 --cameras wrist_wide external --size 96 --out frames
    vispeg render --world S --frames 500 --format bop --out frames-bop
    RAY_ADDRESS=head:6379 vispeg render --world S --frames 100000 --engine ray --workers 64 --out frames
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from vispeg.core.interrupt import goes_on


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg render`."""

    out: Path
    """Folder of the dataset, new or empty."""
    world: str = "S"
    """A built-in world's name or a world file."""
    frames: int = 2000
    """Frames in all: one moment in one look, seen by every camera."""
    looks: int = 1
    """Looks of every episode; its physics runs once."""
    cameras: tuple[str, ...] = ()
    """Cameras to look through; the world's where not given."""
    size: int = 64
    """Pixels of a picture's shorter side; 0 for the cameras' own."""
    seed: int = 0
    """Seed of everything."""
    noise: float = 0.2
    """Standard deviation of what disturbs the expert's actions, as a share of the greatest action."""
    no_labels: bool = False
    """Leave out the pictures of parts; drawing is quicker then. Poses are kept."""
    workers: int = 2
    """Processes of one thread each; 0 for none but this one."""
    engine: Literal["local", "ray"] = "local"
    """Where workers run: on this machine, or on a Ray cluster (the one at RAY_ADDRESS, if set)."""
    format: Literal["lerobot", "bop", "folder"] = "lerobot"
    """Layout of the folder: LeRobotDataset v3.0, BOP, or plain PNG and CSV files."""
    backend: Literal["auto", "classic", "raycast", "filament"] = "auto"
    """Renderer, where the world names none."""
    overwrite: bool = False
    """Replace OUT, if it is there, once the new dataset is complete."""

    @goes_on()
    def run(self) -> int:
        """Renders, and says how fast and where."""
        from vispeg.cli.progress import bars
        from vispeg.core.errors import UserError
        from vispeg.core.extras import require
        from vispeg.core.files import refuse
        from vispeg.core.provenance import provenance
        from vispeg.datasets.engine import local
        from vispeg.datasets.engine_ray import on_ray
        from vispeg.datasets.formats import EXPORTS
        from vispeg.datasets.rendering import render
        from vispeg.demonstrations.plan import plan_of
        from vispeg.demonstrations.stage import shard

        if self.workers < 0:
            raise UserError("must not be negative", key="workers", got=self.workers)
        if self.engine == "ray":
            require("ray", "--engine ray")
        refuse(self.out, self.overwrite, holds="dataset", inputs=(self.world,))
        plan, layout = plan_of(
            self.world,
            self.frames,
            looks=self.looks,
            cameras=self.cameras,
            size=self.size,
            seed=self.seed,
            noise=self.noise,
            labels=not self.no_labels,
            backend=self.backend,
        )
        began = time.monotonic()
        done: list[int] = []
        with bars({"rendering": plan.frames}, "frames") as advance:

            def watch(frames: int) -> None:
                made, took = sum(done[1:]) + frames, max(time.monotonic() - began, 1e-9)
                advance("rendering", frames, f"{made / took:.1f} frames/s" if done else "", known=not done)
                done.append(frames)

            render(
                plan,
                layout,
                shard,
                self.out,
                engine=on_ray if self.engine == "ray" else local,
                workers=self.workers,
                watch=watch,
                export=EXPORTS.get(self.format),
                provenance={"versions": provenance(sys.argv, self.seed)["versions"]},
                overwrite=self.overwrite,
            )
        took, kept = time.monotonic() - began, done[0]
        rate = (
            f"{(plan.frames - kept) / max(took, 1e-9):.1f} frames/s" if kept < plan.frames else "nothing left to draw"
        )
        again = f", {kept} of them from before" if kept else ""
        print(f"{plan.frames} frames of {len(layout.cameras)} cameras in {self.out}{again}; {took:.0f} s, {rate}")
        return 0
