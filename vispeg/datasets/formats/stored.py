"""What datasets of other layouts share with `vispeg.datasets.read.Dataset`: the same attributes, frame by frame."""

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

KEPT = 4  # episodes that stay in memory
LARGEST = 256 * MB  # of a picture's file


class Stored(ABC):
    """A dataset that is read episode by episode.

    Attributes:
        folder: of the dataset.
        features: what a frame holds.
        cameras: by name.
        parts: names of the parts that label pictures count from 1.
        episodes: what is known of each; `length`, and `dataset_from_index`, its first frame.
        info: `fps` (None where the layout does not say) and totals.
        made: `plan`, where it says.
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
        """Give an episode's frames, (T, ...) arrays by feature. Raises UserError for damaged files."""

    def seen(self, number: int, frames: Mapping[str, np.ndarray]) -> Iterator[Seen]:
        """Yield the parts of known surface and pose that an episode's cameras see."""
        yield from ()

    def check(self) -> Iterator[str]:
        """Yield what is wrong beside what reading the frames would tell. Raises UserError where no more can be
        found.
        """
        yield from ()

    def __len__(self) -> int:
        return sum(e["length"] for e in self.episodes)

    def __getitem__(self, index: int) -> dict[str, np.ndarray]:
        number = bisect_right(self._starts, index) - 1
        frames = self.episode(number)
        return {name: frames[name][index - self._starts[number]] for name in self.features}

    def episode(self, number: int) -> dict[str, np.ndarray]:
        """As `read`; a few are kept."""
        if number not in self._kept:
            self._kept[number] = self.read(number)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return self._kept[number]

    @cached_property
    def _starts(self) -> list[int]:
        return [e["dataset_from_index"] for e in self.episodes]


def picture(path: Path, feature: Feature, step: float = DEPTH_STEP) -> np.ndarray:
    """Give a picture file as a feature's pixels; 16-bit depth of `step` m becomes float32 in m.

    Raises:
        UserError: no picture, or one of another size or kind.
    """
    image = decode(read_bytes(path, LARGEST), str(path))
    kind = np.dtype(np.uint16 if is_depth(feature) else np.uint8)
    if image.shape != pixel_shape(feature) or image.dtype != kind:
        expected = f"{pixel_shape(feature)} {kind}"
        raise UserError("a picture of the wrong type", file=path, expected=expected, got=f"{image.shape} {image.dtype}")
    return (image * np.float32(step)).astype(np.float32) if is_depth(feature) else image
