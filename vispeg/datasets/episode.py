"""An episode in one look before it is written to a file: numbers, encoded pictures, and facts about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vispeg.datasets.codec import encode
from vispeg.datasets.layout import Layout, is_image, is_picture, pixel_shape, pixel_type
from vispeg.datasets.stats import PictureStats, Stats, of_numbers


@dataclass(frozen=True)
class Episode:
    """T frames of an episode.

    Attributes:
        values: feature -> (T, ...) numbers or T encoded pictures, without counters.
        stats: feature -> statistics.
        about: facts as JSON values: seeds, drawn parameters, outcome.
    """

    values: Mapping[str, Any]
    stats: Mapping[str, Stats]
    about: Mapping[str, Any]

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))


class Recorder:
    """Collect an episode's frames one by one; pictures are encoded at once to save memory.

    Args:
        layout: the features that each frame must have.
    """

    def __init__(self, layout: Layout):
        self.layout = layout
        self.values: dict[str, list[Any]] = {name: [] for name in layout.features}
        self.pictures = {name: PictureStats(f) for name, f in layout.features.items() if is_picture(f)}

    def add(self, frame: Mapping[str, Any]) -> None:
        """Add a frame: a number, vector or picture for every feature.

        Raises:
            KeyError: a feature is missing.
            ValueError: a picture has another shape or type than in the layout.
        """
        for name, feature in self.layout.features.items():
            value = np.asarray(frame[name])
            if is_picture(feature):
                if value.shape != pixel_shape(feature) or value.dtype != pixel_type(feature):
                    raise ValueError(f"{name}: {value.shape} {value.dtype}, not as the layout says: {feature}")
                self.pictures[name].add(value)
                self.values[name].append(encode(value) if is_image(feature) else value)
            else:
                self.values[name].append(value.astype(feature["dtype"]).reshape(feature["shape"]))

    def finish(self, about: Mapping[str, Any]) -> Episode:
        """Return the episode, with these facts about it."""
        values, stats = {}, {}
        for name, entries in self.values.items():
            values[name] = entries if is_image(self.layout.features[name]) else np.stack(entries)
            stats[name] = self.pictures[name].result() if name in self.pictures else of_numbers(values[name])
        return Episode(values, stats, about)
