"""What a backend draws, and which geoms it draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from vispeg.render.cameras.view import View

HIDDEN = 5  # the geom group in which a backend puts what it leaves out
COLLISION = 3  # this group and those above it hold shapes for contact, never for the eye
DEFAULT_RGBA = np.array([0.5, 0.5, 0.5, 1.0], np.float32)  # a geom of this colour shows its material's


@dataclass(frozen=True, eq=False)
class Picture:
    """One view drawn through a pinhole.

    Attributes:
        rgb: (H, W, 3) uint8, sRGB.
        depth: (H, W) float32, planar, m, 0 where nothing is.
        ids: (H, W) int32 geom ids, -1 where nothing is, or None.
        normals: (H, W, 3) float32 in camera axes, or None where the backend does not know them.
    """

    rgb: np.ndarray
    depth: np.ndarray
    ids: np.ndarray | None = None
    normals: np.ndarray | None = None


class Backend(Protocol):
    """What draws.

    Attributes:
        remembers: whether its next picture depends on those that it has drawn.
    """

    name: str
    remembers: bool

    def draw(self, data: mujoco.MjData, views: Sequence[View], ids: bool) -> list[Picture]:
        """One picture a view, in order; `data` has its kinematics and lights done."""
        ...

    def upload(self, texture: int) -> None:
        """Take over a texture's changed pixels."""
        ...

    def close(self) -> None:
        """Frees what the backend holds."""
        ...


def colours(model: mujoco.MjModel) -> np.ndarray:
    """(ngeom, 4) float32 in [0, 1]: a geom's own colour, or its material's where it has none of its own."""
    material = (model.geom_matid >= 0) & (model.geom_rgba == DEFAULT_RGBA).all(1)
    out = model.geom_rgba.copy()
    out[material] = model.mat_rgba[model.geom_matid[material]]
    return out


def is_visible(model: mujoco.MjModel) -> np.ndarray:
    """(ngeom,) whether a geom is for the eye: below the collision groups and not wholly transparent."""
    return (model.geom_group < COLLISION) & (colours(model)[:, 3] > 0)
