"""Figures of a camera sensor: a few robust numbers per frame, alike for measured and rendered pictures.

Once the borders fit, the rendered picture is passed through the sensor model of a world, and its figures are compared
with those of the measured picture. An effect is thus compared through its own `image` function and needs no separate
formula (method of simulated moments, McFadden, Econometrica 57(5), 1989).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from vispeg.core.rules import RULES
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Figure:
    """Name and tolerances of a figure.

    Attributes:
        name: in words.
        ordinary: difference between good sensors and between appearances; anything smaller is no effect.
        counts: whether it may be the reason to name an effect; else it only helps to fit one.
    """

    name: str
    ordinary: float
    counts: bool = True

    @property
    def floor(self) -> float:
        """Standard deviation of the figure with a correct model, at best."""
        return RULES.figure_repeats * self.ordinary


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
