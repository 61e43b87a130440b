"""Figures of a camera sensor: a few robust numbers per frame, alike for measured and rendered pictures.

Once the borders fit, the rendered picture is passed through the sensor model of a world, and its figures are compared
with those of the measured picture. An effect is thus compared through its own `image` function and needs no separate
formula (method of simulated moments, McFadden, Econometrica 57(5), 1989).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from vispeg.worlds.world import World

NEVER = 1e9  # `ordinary` of a figure that helps to fit effects but is never the reason to name one


@dataclass(frozen=True)
class Figure:
    """Name and tolerances of a figure.

    Attributes:
        name: in words.
        floor: standard deviation of the figure with a correct model, at best.
        ordinary: difference between good sensors and between appearances; anything smaller is no effect.
    """

    name: str
    floor: float
    ordinary: float


class Figures(Protocol):
    """Figures of some frames of one camera."""

    table: tuple[Figure, ...]

    @property
    def measured(self) -> np.ndarray:
        """(frames, figures); NaN where a frame shows too little."""
        ...

    def modelled(self, world: World) -> np.ndarray:
        """Return the figures (frames, figures) of rendered frames after a world's sensor effects."""
        ...
