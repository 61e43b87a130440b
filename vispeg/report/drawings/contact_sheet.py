"""A contact sheet of a world, with no dataset left behind: moments of its task, each in a look of its own."""

from __future__ import annotations

from collections.abc import Iterator
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
    """Give a contact sheet (H, W, 3) uint8: for each frame and each camera of the world its colour, depth and parts.

    Args:
        world: a built-in world's name or a world file.
        frames: how many, each with a look and a sensor drawn anew.
        seed: of everything.
        backend: the renderer, where the world names none.

    Raises:
        UserError: an unknown world, or no renderer that works here.
    """
    plan, layout = plan_of(world, frames, size=64, seed=seed, backend=backend)
    with TemporaryDirectory() as folder:
        render(plan, layout, moments, Path(folder) / "frames", workers=0)
        return sheet(Dataset(Path(folder) / "frames"), frames, width=1500)


def moments(plan: Plan, layout: Layout, wanted: Shard) -> Iterator[Episode]:
    """Episodes of one frame: a few episodes are played, and moments from all over them drawn, each in another look."""
    stage = Stage(plan, layout)
    try:
        played = stage.play([plan.episode_seed(wanted.number, i) for i in range(ROWS)])
        for look in range(wanted.frames):
            seed, states, _, physics = played[look % ROWS]
            share = (look * 0.618034) % 1.0  # the golden ratio: evenly spread, however many there are
            at = int(len(states) * share**2)  # early ones more often: there the goal is in sight
            yield stage.draw(look_seed(seed, look), 0, [states[at]], None, physics)
    finally:
        stage.close()
