"""Datasets out of nothing: episodes whose every number and pixel is known, quickly."""

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from vispeg.core.seeds import stream
from vispeg.datasets.episode import Episode, Recorder
from vispeg.datasets.layout import Layout, depth, flag, numbers, parts, picture
from vispeg.datasets.shards.plan import Plan, Shard, look_seed
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import to_record

EYE = Camera("eye", 12, 8, 10.0, 10.0, 5.5, 3.5, pos=(0.1, -0.2, 0.5), quat=(0.0, 1.0, 0.0, 0.0))
NAMES = ("x", "y", "z", "qw", "qx", "qy", "qz")
PLAN = Plan("made", "0" * 64, frames=40, looks=2, cameras=("eye",), seed=3, shard_frames=15)
LAYOUT = Layout(
    {
        "observation.state": numbers(("a", "b", "c")),
        "action": numbers(("x", "y", "z")),
        "next.done": flag(),
        "label.peg": numbers(NAMES),
        "label.hole": numbers(NAMES),
        "label.camera.eye": numbers(NAMES),
        "observation.images.eye": picture(EYE),
        "observation.depth.eye": depth(EYE),
        "label.parts.eye": parts(EYE),
    },
    (EYE,),
    ("arm", "peg", "fixture"),
    6.25,
    "Do it.",
    "nobody",
)

NOW = {
    "observation.images.eye_depth": "observation.depth.eye",
    "observation.environment_state": "label.environment_state",
}


def as_before(layout: Layout) -> Layout:
    """A layout as datasets had it at first: depth and parts are pictures, the truth is an observation."""
    features = dict(layout.features)
    for before, now in NOW.items():
        if now in features:
            features[before] = features.pop(now)
    for name, feature in features.items():
        if len(feature["shape"]) == 2:
            grey = {"dtype": "image", "shape": [*feature["shape"], 1], "names": ["height", "width", "channels"]}
            features[name] = grey | ({"info": {"is_depth_map": True, "depth_unit": "m"}} if "info" in feature else {})
    return replace(layout, features=features)


def frame(seed: int, look: int, step: int) -> dict[str, np.ndarray]:
    """Frame `step` of an episode: its state follows from the seed, its pictures from the look too."""
    state, seen = stream(seed, step), stream(look_seed(seed, look), step)
    quat = state.standard_normal(4)
    return {
        "observation.state": state.standard_normal(3),
        "action": state.uniform(-1, 1, 3),
        "next.done": step == 5,
        "label.peg": np.concatenate([state.uniform(-0.1, 0.1, 3), quat / np.linalg.norm(quat)]),
        "label.hole": np.array([0.1, -0.15, 0.05, 1, 0, 0, 0]),
        "label.camera.eye": np.array([*EYE.pos, *EYE.quat]),
        "observation.images.eye": seen.integers(0, 256, (8, 12, 3), dtype=np.uint8),
        "observation.depth.eye": (seen.uniform(0.1, 3, (8, 12)) * (seen.uniform(size=(8, 12)) > 0.1)).astype(
            np.float32
        ),
        "label.parts.eye": seen.integers(0, 4, (8, 12), dtype=np.uint8),
    }


def source(plan: Plan, layout: Layout, shard: Shard) -> Iterator[Episode]:
    """Episodes of 4 to 6 frames in every look."""
    left, number = shard.frames, 0
    while left:
        seed = plan.episode_seed(shard.number, number)
        number += 1
        for look in range(plan.looks):
            length = min(left, 4 + seed % 3)
            if not length:
                return
            recorder = Recorder(layout)
            for step in range(length):
                now = frame(seed, look, step)
                recorder.add({name: now[NOW.get(name, name)] for name in layout.features})
            left -= length
            world = {"brightness(all)": {"change": stream(seed, look).uniform(-0.3, 0.3)}}
            about = {"task": layout.task, "seed": seed, "look": look, "redraws": seed % 2, "redraws_exhausted": False}
            about |= {"cut": left == 0, "success": True, "category": "success", "world": world}
            yield recorder.finish(about | {"cameras": [to_record(EYE)]})


def deadly(plan: Plan, layout: Layout, shard: Shard) -> Iterator[Episode]:
    """As `source`, but the first worker to come to shard 1 is killed there."""
    mark = Path(os.environ["VISPEG_TEST_MARK"])
    if shard.number == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    yield from source(plan, layout, shard)


def always_deadly(plan: Plan, layout: Layout, shard: Shard) -> Iterator[Episode]:
    """Kills every worker."""
    os.kill(os.getpid(), signal.SIGKILL)
    yield from source(plan, layout, shard)


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a folder by relative name."""
    return {f.relative_to(folder).as_posix(): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}
