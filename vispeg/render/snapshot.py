"""The state of a cell at one moment, as far as rendering needs it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Snapshot:
    """The state of one row of a batch simulation at one moment.

    Attributes:
        qpos: (nq,) configuration of the cell's model, rad, m and quaternions as MuJoCo has them.
        qvel: (nv,) velocities of its joints, rad/s and m/s.
        bodies: name -> pose (7,) in the parent body's frame, m and quaternion wxyz, of each body that an effect of the
            world displaces.
        count: number of policy steps since the episode began.
    """

    qpos: np.ndarray
    qvel: np.ndarray
    bodies: Mapping[str, np.ndarray]
    count: int = 0
