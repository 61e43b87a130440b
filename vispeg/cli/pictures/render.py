"""Renders a dataset of the expert's episodes in several looks.

The expert plays a world's task, and its cameras draw each moment in several looks. The layout is LeRobotDataset v3.0,
BOP, or plain files. A stopped rendering goes on when the command is repeated and ends with the same bytes; until then
it is in OUT.unfinished. The bytes depend neither on the number of workers nor on the engine. See docs/datasets.md.

Example:
    vispeg render --world S --frames 2000 --out frames
    vispeg render --world S --frames 2000 --looks 4 --cameras wrist_wide external --size 96 --out frames
    vispeg render --world S --frames 500 --format bop --out frames-bop
    RAY_ADDRESS=head:6379 vispeg render --world S --frames 100000 --engine ray --workers 64 --out frames
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from vispeg.cli.output import Output, OutputOptions
from vispeg.core.interrupt import goes_on


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg render`."""

    out: Path
    """Folder of the dataset, new or empty."""
    world: str = "S"
    """A built-in world's name or a world file."""
    frames: int = 2000
    """Frames in all; a frame is one moment in one look, by every camera."""
    looks: int = 1
    """Looks of every episode; its physics runs once."""
    cameras: tuple[str, ...] = ()
    """Cameras; default: the world's."""
    size: int = 64
    """Pixels of a picture's shorter side; 0 for the cameras' own."""
    seed: int = 0
    """Seed of everything random."""
    noise: float = 0.2
    """Noise on the expert's actions: standard deviation, as a share of the greatest action."""
    no_labels: bool = False
    """Draw no segmentation images (faster); poses are still written."""
    modality: Literal["rgbd", "rgb"] = "rgbd"
    """rgb: write no depth, which policies of LeRobot do not see and its loader reads slowly."""
    workers: int = 2
    """Processes of one thread each; 0 for this process alone."""
    engine: Literal["local", "ray"] = "local"
    """Where workers run: on this machine, or on a Ray cluster (the one at RAY_ADDRESS, if set)."""
    format: Literal["lerobot", "bop", "folder"] = "lerobot"
    """Layout of the folder: LeRobotDataset v3.0, BOP, or plain PNG and CSV files."""
    backend: Literal["auto", "classic", "raycast", "filament"] = "auto"
    """Renderer, if the world names none."""
    overwrite: bool = False
    """Replace OUT if it exists, once the new dataset is complete."""

    output: OutputOptions = Output()

    @goes_on()
    def run(self) -> int:
        """Render, and say how fast and where."""
        from vispeg.api.datasets import render_dataset
        from vispeg.cli.progress import rendering

        with rendering(self.frames, self.output.quiet) as (begun, watch):
            result = render_dataset(
                self.out,
                self.world,
                frames=self.frames,
                looks=self.looks,
                cameras=self.cameras,
                size=self.size,
                seed=self.seed,
                noise=self.noise,
                labels=not self.no_labels,
                modality=self.modality,
                workers=self.workers,
                engine=self.engine,
                format=self.format,
                backend=self.backend,
                overwrite=self.overwrite,
                begun=begun,
                watch=watch,
            )
        self.output.give(result.record, result.summary)
        return 0
