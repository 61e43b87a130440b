"""The base class of datasets in other layouts, with the attributes of `vispeg.datasets.read.Dataset`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.datasets.codec import DEPTH_STEP, decode
from vispeg.datasets.describe import Made
from vispeg.datasets.episodes import Stretch
from vispeg.datasets.layout import Feature, is_depth, pixel_shape
from vispeg.datasets.moments import Seen
from vispeg.formats.guard import MB, read_bytes
from vispeg.render.cameras.camera import Camera

KEPT = 4  # number of episodes kept in memory
LARGEST = 256 * MB  # largest file of a picture


class Stored(ABC):
    """A dataset that is read episode by episode.

    Attributes:
        folder: folder of the dataset.
        features: name -> feature of a frame.
        cameras: name -> camera.
        parts: names of the parts, which label pictures number from 1.
        episodes: facts about each episode, including `length` and `dataset_from_index`, the number of its first frame.
        info: `fps` (None if the layout does not state it) and totals.
        made: how the dataset was rendered: its `plan`, if stated.
    """

    features: Mapping[str, Feature]
    cameras: Mapping[str, Camera]
    parts: tuple[str, ...]
    episodes: Sequence[Stretch]
    info: Mapping[str, Any]
    made: Made

    def __init__(self, folder: str | Path):
        self.folder = Path(folder).expanduser()
        self._kept: OrderedDict[int, dict[str, np.ndarray]] = OrderedDict()

    @abstractmethod
    def read(self, number: int) -> dict[str, np.ndarray]:
        """Read an episode's frames: feature -> (T, ...) array. Raises UserError: damaged files."""

    def seen(self, number: int, frames: Mapping[str, np.ndarray]) -> Iterator[Seen]:
        """Yield the parts with known surface and pose in each camera's pictures of an episode."""
        yield from ()

    def check(self) -> Iterator[str]:
        """Yield faults that reading the frames would not show. Raises UserError: a fault that ends the search."""
        yield from ()

    def __len__(self) -> int:
        return sum(e["length"] for e in self.episodes)

    def __getitem__(self, index: int) -> dict[str, np.ndarray]:
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        index %= len(self)
        number = bisect_right(self._starts, index) - 1
        frames = self.episode(number)
        return {name: frames[name][index - self._starts[number]] for name in self.features}

    def episode(self, number: int) -> dict[str, np.ndarray]:
        """Return an episode's frames as `read` does; the last KEPT episodes stay in memory."""
        if number not in self._kept:
            self._kept[number] = self.read(number)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return self._kept[number]

    @cached_property
    def _starts(self) -> list[int]:
        return [e["dataset_from_index"] for e in self.episodes]


def picture(path: Path, feature: Feature, step: float = DEPTH_STEP) -> np.ndarray:
    """Read a picture file as pixels of a feature; 16-bit depth in steps of `step` m becomes float32 in m.

    Raises:
        UserError: not a picture, or one of another size or type.
    """
    image = decode(read_bytes(path, LARGEST), str(path))
    kind = np.dtype(np.uint16 if is_depth(feature) else np.uint8)
    if image.shape != pixel_shape(feature) or image.dtype != kind:
        expected = f"{pixel_shape(feature)} {kind}"
        raise UserError("a picture of the wrong type", file=path, expected=expected, got=f"{image.shape} {image.dtype}")
    return (image * np.float32(step)).astype(np.float32) if is_depth(feature) else image
