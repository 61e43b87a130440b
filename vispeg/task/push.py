"""A push at the flange, as a person or a cable would give it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Push:
    """A constant force for a while.

    Attributes:
        force: (3,) N, world frame.
        start, duration: s since the episode began.
    """

    force: np.ndarray
    start: float
    duration: float
