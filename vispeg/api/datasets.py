"""`vispeg.render_dataset`: a randomized RGB-D dataset of the task; and `check_dataset`: whether one is whole."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from vispeg.core.errors import UserError
from vispeg.core.extras import require
from vispeg.core.files import reserved
from vispeg.core.provenance import here
from vispeg.core.several import several
from vispeg.datasets.check import check
from vispeg.datasets.formats.registry import EXPORTS
from vispeg.datasets.formats.stored import Stored
from vispeg.datasets.opening import open_dataset
from vispeg.datasets.read import Dataset
from vispeg.datasets.shards.engine import local, on_ray
from vispeg.datasets.shards.rendering import render
from vispeg.report.text.summary import Block, Line, html

Begun = Callable[[int, int], None]  # called with the number of frames, and of those of an earlier run


@dataclass(frozen=True)
class RenderedDataset:
    """A dataset on disk.

    Attributes:
        path: its folder.
        frames: in all; one moment in one look, seen by every camera.
        cameras: their names.
        resumed: frames that an earlier run had left.
        seconds: that the others took.
    """

    path: Path
    frames: int
    cameras: tuple[str, ...]
    resumed: int
    seconds: float

    def open(self) -> Dataset | Stored:
        """Give the dataset, to read frames from."""
        return open_dataset(self.path)

    @property
    def record(self) -> dict[str, object]:
        """What `vispeg render --json` prints."""
        numbers = {"frames": self.frames, "resumed": self.resumed, "seconds": round(self.seconds, 1)}
        return {"dataset": str(self.path), "cameras": list(self.cameras), **numbers}

    @property
    def summary(self) -> list[Block]:
        """How many frames of how many cameras, where, and how fast."""
        new = self.frames - self.resumed
        rate = f"{new / max(self.seconds, 1e-9):.1f} frames/s" if new else "nothing left to draw"
        again = f", {self.resumed} of them from before" if self.resumed else ""
        text = (
            f"{self.frames} frames of {len(self.cameras)} cameras in {self.path}{again}; {self.seconds:.0f} s, {rate}"
        )
        return [Line(text, path=True)]

    def _repr_html_(self) -> str:
        return html(self.summary)


@dataclass(frozen=True)
class CheckedDataset:
    """What is wrong with a dataset.

    Attributes:
        path: its folder, as it was named.
        faults: a line each; empty where nothing is wrong.
        frames, episodes: how many.
        megabytes: of all its files.
    """

    path: Path
    faults: Sequence[str]
    frames: int
    episodes: int
    megabytes: float

    @property
    def record(self) -> dict[str, object]:
        """What `vispeg dataset check --json` prints."""
        sizes = {"frames": self.frames, "episodes": self.episodes, "megabytes": round(self.megabytes, 1)}
        return {"dataset": str(self.path), **({} if self.faults else sizes), "wrong": [*self.faults]}

    @property
    def summary(self) -> list[Block]:
        """A line for each fault, or the size of a dataset without any."""
        if self.faults:
            return [Line(fault, path=True) for fault in self.faults]
        many = f"{self.episodes} episode" + "s" * (self.episodes != 1)
        text = f"{self.path}: {self.frames} frames in {many}, {self.megabytes:.1f} MB, nothing wrong"
        return [Line(text, path=True)]

    def _repr_html_(self) -> str:
        return html(self.summary)


def check_dataset(
    dataset: str | Path, *, watch: Callable[[int, int], None] = lambda frames, total: None
) -> CheckedDataset:
    """Find records that are cut short, changed, repeated or contradictory, in any layout.

    Args:
        dataset: folder of the dataset.
        watch: called with the number of frames just checked and of all.

    Raises:
        UserError: no dataset at all, or one whose `meta/info.json` cannot be read.
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
    format: Literal["lerobot", "bop", "folder"] = "lerobot",
    backend: Literal["auto", "classic", "raycast", "filament"] = "auto",
    overwrite: bool = False,
    begun: Begun = lambda frames, resumed: None,
    watch: Callable[[int], None] = lambda frames: None,
) -> RenderedDataset:
    """Render a dataset: the expert plays, and the cameras draw each moment in several looks; see docs/datasets.md.

    A stopped rendering goes on when it is called again, and ends with the same bytes.

    Args:
        out: folder of the dataset, new or empty.
        world: a built-in world's name or a world file.
        frames: frames in all; a frame is one moment in one look, by every camera.
        looks: looks of every episode; its physics runs once.
        cameras: cameras; default: the world's.
        size: pixels of a picture's shorter side; 0 for the cameras' own.
        seed: seed of everything random.
        noise: noise on the expert's actions: standard deviation, as a share of the greatest action.
        labels: draw segmentation images; poses are always written.
        modality: rgb: write no depth, which policies of LeRobot do not see and its loader reads slowly.
        workers: processes of one thread each; 0 for this process alone.
        engine: where workers run: on this machine, or on a Ray cluster (the one at RAY_ADDRESS, if set).
        format: layout of the folder: LeRobotDataset v3.0, BOP, or plain PNG and CSV files.
        backend: renderer, if the world names none.
        overwrite: replace `out` if it exists, once the new dataset is complete.
        begun: called once with the number of frames, and of those that exist.
        watch: called with frames as they are drawn.

    Raises:
        UserError: an unknown world or camera, impossible numbers, or `out` holds something else.
    """
    from vispeg.demonstrations.plan import plan_of
    from vispeg.demonstrations.stage import shard

    if workers < 0:
        raise UserError("must not be negative", key="workers", got=workers)
    if modality == "rgb" and format == "bop":
        raise UserError("BOP has depth", key="modality", expected="rgbd", got=modality)
    if engine == "ray":
        require("ray", "--engine ray")
    shape = {"looks": looks, "cameras": several(cameras), "size": size, "seed": seed, "noise": noise}
    start, resumed = time.monotonic(), list[int]()

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
    return RenderedDataset(Path(out).expanduser(), plan.frames, names, before, seconds)
