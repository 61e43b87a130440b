"""A dataset of a few invented frames, as an example of its format."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.seeds import stream
from vispeg.datasets.episode import Episode, Recorder
from vispeg.datasets.layout import Layout, depth, flag, numbers, parts, picture
from vispeg.datasets.shards.plan import Plan, Shard
from vispeg.datasets.shards.rendering import render
from vispeg.datasets.shards.shard import Source, shard_bytes
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import to_record

EYE = Camera("eye", 12, 8, 10.0, 10.0, 5.5, 3.5)
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
PLAN = Plan("invented", "0" * 64, frames=6, cameras=("eye",), shard_frames=3)
FEATURES = {
    "observation.state": numbers(("a", "b")),
    "action": numbers(("x", "y", "z")),
    "next.done": flag(),
    "label.tool": numbers(POSE),
    "label.goal": numbers(POSE),
    "label.camera.eye": numbers(POSE),
    "observation.images.eye": picture(EYE),
    "observation.depth.eye": depth(EYE),
    "label.parts.eye": parts(EYE),
}
LAYOUT = Layout(FEATURES, (EYE,), ("arm", "tool"), 6.25, "Do it.", "nobody")


def write_dataset(folder: Path) -> Path:
    """Write a dataset of six frames in two files below `folder`; return the dataset's folder."""
    return render(PLAN, LAYOUT, invented, folder / "dataset", engine=_here)


def _here(
    wanted: Sequence[Shard], source: Source, plan: Plan, layout: Layout, *_: Any
) -> Iterator[tuple[Shard, bytes]]:
    return ((shard, shard_bytes(source, plan, layout, shard)) for shard in wanted)


def invented(plan: Plan, layout: Layout, shard: Shard) -> Iterator[Episode]:
    """Yield the single episode of a shard, with random content."""
    rng, recorder = stream(plan.seed, "example", shard.number), Recorder(layout)
    pose = np.array([0.1, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0])
    for step in range(shard.frames):
        frame = {"observation.state": rng.standard_normal(2), "action": rng.uniform(-1, 1, 3)}
        frame |= {
            "next.done": step == shard.frames - 1,
            "label.tool": pose,
            "label.goal": pose,
            "label.camera.eye": pose,
        }
        frame["observation.images.eye"] = rng.integers(0, 256, (8, 12, 3), dtype=np.uint8)
        frame["observation.depth.eye"] = rng.uniform(0.1, 3, (8, 12)).astype(np.float32)
        frame["label.parts.eye"] = rng.integers(0, 3, (8, 12), dtype=np.uint8)
        recorder.add(frame)
    about = {"task": layout.task, "seed": plan.episode_seed(shard.number, 0), "look": 0, "redraws": 0}
    about |= {"redraws_exhausted": False, "cut": False, "success": True, "category": "success", "world": {}}
    yield recorder.finish(about | {"cameras": [to_record(EYE)]})
