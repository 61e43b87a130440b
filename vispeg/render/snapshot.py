"""How a cell stands at one moment: all that whoever draws it needs to know of its simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Snapshot:
    """One row of a simulation at one moment.

    Attributes:
        qpos: (nq,) configuration of the cell's model.
        bodies: by name, where a body is placed in its parent if its world moves it: (7,) m and quaternion wxyz.
        twist: (6,) of the flange, base axes, m/s and rad/s.
        flange: (3,) its position, m.
        count: policy steps since the episode began.
    """

    qpos: np.ndarray
    bodies: Mapping[str, np.ndarray]
    twist: np.ndarray
    flange: np.ndarray
    count: int = 0
