"""Show pictures in a panel, each with its name, enlarged so that pixels can be seen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from vispeg.view.place import Place

LEAST = 192  # px; smaller pictures are enlarged to at least this height


class Gallery:
    """Add the pictures to the part of the page that is being built."""

    def __init__(self, place: Place):
        self.place, self.root = place, place.gui.add_folder(None)
        self.images: dict[str, Any] = {}

    def show(self, pictures: Mapping[str, np.ndarray]) -> None:
        """Show these pictures (H, W, 3) uint8 in place of the previous ones."""
        for key in [key for key in self.images if key not in pictures]:
            self.images.pop(key).remove()
        for key, image in pictures.items():
            times = max(1, math.ceil(LEAST / image.shape[0]))
            large = image.repeat(times, axis=0).repeat(times, axis=1)
            if key in self.images:
                self.images[key].image = large
            else:
                with self.root:
                    self.images[key] = self.place.gui.add_image(large, label=key, format="jpeg")
