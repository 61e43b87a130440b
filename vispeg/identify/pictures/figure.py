"""Figures of a sensor: a few robust numbers a frame, taken alike of measured pictures and of modelled ones.

Where the borders fit, the rendered picture passes through the sensor that a world says, and the same figures are taken
of it as of the measured one. So an effect is compared by its own `image`, without a formula beside it (the method of
simulated moments, McFadden, Econometrica 57(5), 1989).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from vispeg.worlds.world import World

NEVER = 1e9  # ordinary deviation of a figure that helps to fit an effect and names none by itself


@dataclass(frozen=True)
class Figure:
    """What a figure is sure of.

    Attributes:
        name: in words.
        floor: by which it is off for reasons of its own, 1 sigma at best.
        ordinary: by which it differs between good sensors and between looks: less is no effect.
    """

    name: str
    floor: float
    ordinary: float


class Figures(Protocol):
    """The figures of some frames of one camera."""

    table: tuple[Figure, ...]

    @property
    def measured(self) -> np.ndarray:
        """(frames, figures); NaN where a frame shows too little."""
        ...

    def modelled(self, world: World) -> np.ndarray:
        """Give the same of rendered frames that passed through a world's sensor."""
        ...
