"""A commanded motion of the flange in a cell, from `motions` or from a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class CellMotion:
    """A commanded motion of the flange in a cell.

    Attributes:
        name: of the motion.
        time: (n,) s.
        ee_cmd: (n, 7) commanded flange pose in the base, m and w x y z.
        force_limit: N, greatest force that the controller may ask for in this motion; None for the task's setting.
        stiffness: of the controller in this motion, 1/s^2, for translation and rotation; None for the task's setting.
        posture: (nj,) rad, joint angles near which the motion begins and to which the null space is pulled; None for
            the cell's posture (`vispeg.task.rig.posture.posture`).
    """

    name: str
    time: np.ndarray
    ee_cmd: np.ndarray
    force_limit: float | None = None
    stiffness: tuple[float, float] | None = None
    posture: np.ndarray | None = None
