"""The interface of a rendering backend, its result, and which geoms are visible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from vispeg.render.cameras.view import View

HIDDEN = 5  # geom group to which a backend assigns geoms that it does not draw
COLLISION = 3  # this group and higher ones hold collision shapes, which are never drawn
DEFAULT_RGBA = np.array([0.5, 0.5, 0.5, 1.0], np.float32)  # MuJoCo's default; replaced by the material's


@dataclass(frozen=True, eq=False)
class Picture:
    """The image of one view without lens distortion.

    Attributes:
        rgb: (H, W, 3) uint8, sRGB.
        depth: (H, W) float32, distance along the optical axis, m, 0 for no hit.
        ids: (H, W) int32 geom ids, -1 for no hit; None if not asked for.
        normals: (H, W, 3) float32 surface normals in camera axes; None if the backend does not compute them.
    """

    rgb: np.ndarray
    depth: np.ndarray
    ids: np.ndarray | None = None
    normals: np.ndarray | None = None


class Backend(Protocol):
    """A rendering backend.

    Attributes:
        name: the name by which users select it.
        remembers: whether its next picture depends on the pictures that it has drawn.
    """

    name: str
    remembers: bool

    def draw(self, data: mujoco.MjData, views: Sequence[View], ids: bool) -> list[Picture]:
        """Return one picture per view, in order, with geom ids if `ids`.

        The kinematics and lights of `data` must be computed.
        """
        ...

    def upload(self, texture: int) -> None:
        """Apply a texture's changed pixels."""
        ...

    def close(self) -> None:
        """Free what the backend holds."""
        ...


def colours(model: mujoco.MjModel) -> np.ndarray:
    """Return the colours (ngeom, 4) float32 in [0, 1]: a geom's own, or its material's if it has none of its own."""
    material = (model.geom_matid >= 0) & (model.geom_rgba == DEFAULT_RGBA).all(1)
    out = model.geom_rgba.copy()
    out[material] = model.mat_rgba[model.geom_matid[material]]
    return out


def is_visible(model: mujoco.MjModel) -> np.ndarray:
    """Return whether each geom is visible, (ngeom,) bool: in no collision group and not fully transparent."""
    return (model.geom_group < COLLISION) & (colours(model)[:, 3] > 0)
