"""`vispeg.render_dataset` renders a randomized dataset of the task; `check_dataset` checks a dataset for damage."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.core.extras import require
from vispeg.core.files import reserved
from vispeg.core.paths import expanded
from vispeg.core.provenance import here
from vispeg.core.several import several
from vispeg.datasets.check import check
from vispeg.datasets.formats.read_bop import Bop
from vispeg.datasets.formats.registry import EXPORTS
from vispeg.datasets.opening import open_dataset
from vispeg.datasets.read import Dataset
from vispeg.datasets.shards.engine import local, on_ray
from vispeg.datasets.shards.rendering import render
from vispeg.report.text.summary import Block, Line, Summarised

Begun = Callable[[int, int], None]  # called with the number of frames in all, and of those from an earlier run


@dataclass(frozen=True)
class RenderedDataset(Summarised):
    """A dataset on disk.

    Attributes:
        path: folder of the dataset.
        frames: total number of frames; a frame is one moment in one look, seen by every camera.
        cameras: names of the cameras.
        resumed: number of frames from an earlier run.
        seconds: time that the other frames took, s.
    """

    path: Path
    frames: int
    cameras: tuple[str, ...]
    resumed: int
    seconds: float

    def open(self) -> Dataset | Bop:
        """Open the dataset for reading."""
        return open_dataset(self.path)

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg render --json`."""
        numbers = {"frames": self.frames, "resumed": self.resumed, "seconds": round(self.seconds, 1)}
        return {"dataset": str(self.path), "cameras": list(self.cameras), **numbers}

    @property
    def summary(self) -> list[Block]:
        """A line with numbers of frames and cameras, folder, and speed."""
        new = self.frames - self.resumed
        rate = f"{new / max(self.seconds, 1e-9):.1f} frames/s" if new else "nothing left to draw"
        earlier = f", {self.resumed} of them from before" if self.resumed else ""
        made = f"{count(self.frames, 'frame')} of {count(len(self.cameras), 'camera')} in {self.path}{earlier}"
        text = f"{made}; {self.seconds:.0f} s, {rate}"
        return [Line(text, path=True)]


@dataclass(frozen=True)
class CheckedDataset(Summarised):
    """The result of a check of a dataset.

    Attributes:
        path: folder of the dataset, as named by the user.
        faults: one line per fault; empty if nothing is wrong.
        frames, episodes: number of frames and of episodes.
        megabytes: size of all its files, MB.
    """

    path: Path
    faults: Sequence[str]
    frames: int
    episodes: int
    megabytes: float

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg dataset check --json`."""
        sizes = {"frames": self.frames, "episodes": self.episodes, "megabytes": round(self.megabytes, 1)}
        return {"dataset": str(self.path), **({} if self.faults else sizes), "wrong": [*self.faults]}

    @property
    def summary(self) -> list[Block]:
        """One line per fault, or the size of a faultless dataset."""
        if self.faults:
            return [Line(fault, path=True) for fault in self.faults]
        found = f"{count(self.frames, 'frame')} in {count(self.episodes, 'episode')}"
        text = f"{self.path}: {found}, {self.megabytes:.1f} MB, nothing wrong"
        return [Line(text, path=True)]


def check_dataset(
    dataset: str | Path, *, watch: Callable[[int, int], None] = lambda frames, total: None
) -> CheckedDataset:
    """Find records that are truncated, changed, repeated or contradictory, in a dataset of any layout.

    Args:
        dataset: folder of the dataset.
        watch: called with the number of frames just checked, and of all frames.

    Raises:
        UserError: no dataset, or its `meta/info.json` cannot be read.
    """
    data = open_dataset(dataset)
    faults = check(dataset, lambda frames: watch(frames, len(data)))
    megabytes = sum(f.stat().st_size for f in data.folder.rglob("*") if f.is_file()) / 1e6
    return CheckedDataset(Path(dataset), faults, len(data), len(data.episodes), megabytes)


def render_dataset(
    out: str | Path,
    world: str | Path = "S",
    *,
    frames: int = 2000,
    looks: int = 1,
    cameras: str | Sequence[str] = (),
    size: int = 64,
    seed: int = 0,
    noise: float = 0.2,
    labels: bool = True,
    modality: Literal["rgbd", "rgb"] = "rgbd",
    workers: int = 2,
    engine: Literal["local", "ray"] = "local",
    format: Literal["lerobot", "bop"] = "lerobot",
    backend: Literal["auto", "classic", "raycast", "filament"] = "auto",
    overwrite: bool = False,
    begun: Begun = lambda frames, resumed: None,
    watch: Callable[[int], None] = lambda frames: None,
) -> RenderedDataset:
    """Render a dataset: the expert plays, and the cameras render each moment in several looks; see docs/datasets.md.

    Call it again to continue a stopped rendering; the result has the same bytes.

    Args:
        out: folder of the dataset, new or empty.
        world: a built-in world's name or a world file.
        frames: total number of frames; a frame is one moment in one look, seen by every camera.
        looks: number of looks of every episode; its physics runs once.
        cameras: cameras; default: the world's.
        size: pixels of a picture's shorter side; 0 for the cameras' own size.
        seed: seed of everything random.
        noise: standard deviation of the noise on the expert's actions, as a share of the largest action.
        labels: draw segmentation images; poses are always written.
        modality: rgb writes no depth, which LeRobot's policies do not use and its loader reads slowly.
        workers: number of processes with one thread each; 0 to use only this process.
        engine: where workers run: on this machine, or on a Ray cluster (the one at RAY_ADDRESS, if set).
        format: layout of the folder: LeRobotDataset v3.0, or BOP, which pose estimators read.
        backend: renderer, if the world names none.
        overwrite: replace `out` if it exists, once the new dataset is complete.
        begun: called once with the number of frames, and of those that exist already.
        watch: called with the number of new frames after each batch.

    Raises:
        UserError: an unknown world, camera, format or engine, impossible numbers, or `out` holds other files.
    """
    from vispeg.demonstrations.plan import plan_of
    from vispeg.demonstrations.stage import shard

    if workers < 0:
        raise UserError("must not be negative", key="workers", got=workers)
    for key, got, choices in (("format", format, ("lerobot", *EXPORTS)), ("engine", engine, ("local", "ray"))):
        if got not in choices:
            raise UserError(f"unknown {key}", key=key, got=got, choices=choices)
    if modality == "rgb" and format == "bop":
        raise UserError("BOP requires depth", key="modality", expected="rgbd", got=modality)
    if engine == "ray":
        require("ray", "--engine ray")
    shape = {"looks": looks, "cameras": several(cameras), "size": size, "seed": seed, "noise": noise}
    start = time.monotonic()
    resumed = list[int]()  # number of frames of an earlier run; empty until the first call of `on_frames`

    def on_frames(drawn: int) -> None:
        if not resumed:
            resumed.append(drawn)
            begun(plan.frames, drawn)
        else:
            watch(drawn)

    with reserved(out, overwrite, holds="dataset", inputs=(world,)):
        plan, layout = plan_of(str(world), frames, labels=labels, backend=backend, modality=modality, **shape)
        render(
            plan,
            layout,
            shard,
            out,
            engine=on_ray if engine == "ray" else local,
            workers=workers,
            watch=on_frames,
            export=EXPORTS.get(format),
            provenance={"versions": here(seed, {})["versions"]},
            overwrite=overwrite,
        )
    names = tuple(camera.name for camera in layout.cameras)
    before, seconds = resumed[0] if resumed else 0, time.monotonic() - start
    return RenderedDataset(expanded(out), plan.frames, names, before, seconds)
