"""Read frames of a dataset in a worker process: pictures, labels, and the values drawn for each."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.api.datasets import render_dataset
from vispeg.core.errors import UserError
from vispeg.datasets.episodes import OWN
from vispeg.datasets.formats.read_bop import Bop
from vispeg.datasets.layout import colour_of, depth_of
from vispeg.datasets.opening import open_dataset
from vispeg.datasets.read import Dataset
from vispeg.render.image_kinds import depth_picture
from vispeg.report.dataset.pictures import chosen, depth_range, part_picture
from vispeg.report.text.quantities import plain

SAMPLED = 12  # number of frames from which the depth range is taken
MOST = 12  # features with more numbers are not shown


@dataclass(frozen=True)
class Holding:
    """Description of an open dataset.

    Attributes:
        name: name of its folder.
        frames: total number of frames.
        starts: number of the first frame of each episode.
        cameras, parts: names of the cameras and of the labelled parts.
        fps: frames per second; None if the dataset does not say.
        worlds: values drawn for each episode: label of the effect -> parameter -> value.
    """

    name: str
    frames: int
    starts: tuple[int, ...]
    cameras: tuple[str, ...]
    parts: tuple[str, ...]
    fps: float | None
    worlds: tuple[Mapping[str, Mapping[str, float]], ...]


@dataclass(frozen=True)
class Frame:
    """One frame: its number, its episode and row in that, pictures (H, W, 3) uint8, facts, and its drawn values."""

    number: int
    episode: int
    row: int
    pictures: Mapping[str, np.ndarray]
    facts: list[tuple[str, str]]
    drawn: list[tuple[str, str]]


class Frames:
    """The object of the page's worker; `tell` gets "dataset" (Holding) and "frame" (Frame)."""

    def __init__(self, tell: Callable[[str, Any], None]):
        self.tell, self.data = tell, None
        self.limits: Mapping[str, tuple[float, float]] = {}

    def open(self, folder: str) -> None:
        """Open a dataset, and send its description and first frame. Raises UserError: it cannot be read."""
        self.tell("say", "reading the dataset")
        data = self.data = open_dataset(folder)
        self.limits = depth_range(data, [data[i] for i in chosen(data, SAMPLED)])
        holding = Holding(
            name=data.folder.resolve().name,
            frames=len(data),
            starts=tuple(e["dataset_from_index"] for e in data.episodes),
            cameras=tuple(data.cameras),
            parts=tuple(data.parts),
            fps=data.info.get("fps"),
            worlds=tuple(_drawn(dict(e)) for e in data.episodes),
        )
        self.tell("dataset", holding)
        self.frame(0)

    def render(self, out: Path) -> str:
        """Render a small dataset; return its folder. Raises UserError: the folder exists already."""
        self.tell("say", "rendering 8 frames")
        render_dataset(out, "S", frames=8, looks=4, size=96, workers=0)
        return str(out)

    def frame(self, number: int) -> None:
        """Send a frame. Raises UserError: it cannot be read."""
        if self.data is None:
            raise UserError("no dataset is open")
        data, frame = self.data, self.data[number]
        starts = [e["dataset_from_index"] for e in data.episodes]
        k = bisect_right(starts, number) - 1
        facts = [("outcome", str(dict(data.episodes[k]).get(f"{OWN}category") or "")), *_numbers(frame)]
        drawn = [
            (label, ", ".join(f"{n} {plain(v)}" for n, v in params.items())) for label, params in _drawn_of(data, k)
        ]
        pictures = {label: picture for name in data.cameras for label, picture in self._views(frame, name)}
        self.tell("frame", Frame(number, k, number - starts[k], pictures, [f for f in facts if f[1]], drawn))

    def _views(self, frame: Mapping[str, np.ndarray], name: str) -> list[tuple[str, np.ndarray]]:
        """Return the (label, picture) pairs of a camera that the frame has: colour, depth, parts."""
        out = []
        if (colour := frame.get(colour_of(name))) is not None:
            out.append((f"{name}, colour", colour))
        if (depth := frame.get(depth_of(name, frame))) is not None:
            low, high = self.limits[name]
            out.append((f"{name}, depth {low:.2f} to {high:.2f} m", depth_picture(depth, low, high)))
        if (parts := frame.get(f"label.parts.{name}")) is not None:
            out.append((f"{name}, parts", part_picture(parts)))
        return [(label, np.ascontiguousarray(image)) for label, image in out]


def _drawn(episode: Mapping[str, Any]) -> Mapping[str, Mapping[str, float]]:
    return episode.get(f"{OWN}world") or {}


def _drawn_of(data: Dataset | Bop, episode: int) -> list[tuple[str, Mapping[str, float]]]:
    return list(_drawn(dict(data.episodes[episode])).items())


def _numbers(frame: Mapping[str, np.ndarray]) -> list[tuple[str, str]]:
    """Return (name, text) of each feature that is a text or has at most `MOST` numbers, such as actions and poses."""
    out = []
    for name, value in frame.items():
        flat = np.asarray(value).ravel()
        if 0 < flat.size <= MOST and np.issubdtype(flat.dtype, np.number):
            out.append((name, ", ".join(plain(float(v), 3) for v in flat)))
        elif flat.size == 1 and flat.dtype.kind in "US":
            out.append((name, str(flat[0])))
    return out
