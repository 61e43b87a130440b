"""A motion of the flange that is commanded in a cell, made by name or read from a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class CellMotion:
    """A commanded motion of the flange in a cell.

    Attributes:
        name: of the motion.
        time: (n,) s.
        ee_cmd: (n, 7) flange pose in the base, m and w x y z.
        force_limit: N, greatest force that the controller may ask for in it; None for the task's own.
        stiffness: of the controller in it, 1/s^2, for translation and rotation; None for the task's own.
        posture: (nj,) rad, joint angles that it begins near and that the null space is pulled to; None for the cell's.
    """

    name: str
    time: np.ndarray
    ee_cmd: np.ndarray
    force_limit: float | None = None
    stiffness: tuple[float, float] | None = None
    posture: np.ndarray | None = None
