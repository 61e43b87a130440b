"""Make a contact sheet of a world without keeping a dataset: moments of its task, each with a different look."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from vispeg.datasets.episode import Episode
from vispeg.datasets.layout import Layout
from vispeg.datasets.read import Dataset
from vispeg.datasets.shards.plan import Plan, Shard, look_seed
from vispeg.datasets.shards.rendering import render
from vispeg.demonstrations.plan import plan_of
from vispeg.demonstrations.stage import ROWS, Stage
from vispeg.report.dataset.pictures import sheet

FRAMES = 24


def draw(world: str = "S", frames: int = FRAMES, seed: int = 0, backend: str = "auto") -> np.ndarray:
    """Return a contact sheet (H, W, 3) uint8: for each frame the colour, depth and parts of each camera of the world.

    Args:
        world: a built-in world's name or a world file.
        frames: number of frames, each with its own draw of look and sensor.
        seed: seed of all draws.
        backend: the renderer, unless the world names one.

    Raises:
        UserError: an unknown world, or no working renderer.
    """
    plan, layout = plan_of(world, frames, size=64, seed=seed, backend=backend)
    with TemporaryDirectory() as folder:
        render(plan, layout, moments, Path(folder) / "frames", workers=0)
        return sheet(Dataset(Path(folder) / "frames"), frames, width=1500)


def moments(plan: Plan, layout: Layout, wanted: Shard) -> Iterator[Episode]:
    """Play a few episodes; yield single moments of them, each as an episode of one frame with another look."""
    stage = Stage(plan, layout)
    try:
        played = stage.play([plan.episode_seed(wanted.number, i) for i in range(ROWS)])
        for look in range(wanted.frames):
            episode = played[look % ROWS]
            share = (look * 0.618034) % 1.0  # golden ratio: evenly spread for any number of frames
            at = int(len(episode.moments) * share**2)  # early moments more often, because then the goal is in sight
            one = replace(episode, seed=look_seed(episode.seed, look), moments=[episode.moments[at]], record=None)
            yield stage.draw(one, 0, 1)
    finally:
        stage.close()
