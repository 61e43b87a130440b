"""The interface of a rendering backend, the picture that it returns, and the colours and visibility of geoms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from vispeg.render.cameras.view import View

HIDDEN = 5  # geom group into which a backend moves the geoms that it does not draw
COLLISION = 3  # geoms in this group and higher ones are collision shapes, which are never drawn
DEFAULT_RGBA = np.array([0.5, 0.5, 0.5, 1.0], np.float32)  # a geom whose file states no colour


@dataclass(frozen=True, eq=False)
class Picture:
    """The image of one view without lens distortion.

    Attributes:
        rgb: (H, W, 3) uint8, sRGB.
        depth: (H, W) float32, m, distance along the optical axis; 0 where no geom is seen.
        ids: (H, W) int32, index of the geom seen, -1 where there is none; None if not asked for.
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
        remembers: whether a picture depends also on those drawn before it.
    """

    name: str
    remembers: bool

    def draw(self, data: mujoco.MjData, views: Sequence[View], ids: bool) -> list[Picture]:
        """Return one picture per view, in the order of `views`, with geom ids if `ids` is true.

        `data` must hold the poses of bodies, geoms, cameras and lights that belong to its state.
        """
        ...

    def upload(self, texture: int) -> None:
        """Take the changed pixels of the texture with this index from the model for all later pictures."""
        ...

    def close(self) -> None:
        """Free the backend's memory and contexts; it cannot draw afterwards."""
        ...


def colours(model: mujoco.MjModel) -> np.ndarray:
    """Return the colours (ngeom, 4) float32 in [0, 1]: a geom's own, or its material's if its own is DEFAULT_RGBA."""
    material = (model.geom_matid >= 0) & (model.geom_rgba == DEFAULT_RGBA).all(1)
    out = model.geom_rgba.copy()
    out[material] = model.mat_rgba[model.geom_matid[material]]
    return out


def alphas(model: mujoco.MjModel) -> np.ndarray:
    """Return the alphas (ngeom,) of `colours`, faster."""
    # if all materials have the default alpha, a geom that takes its material's colour has the right alpha itself
    if (model.mat_rgba[:, 3] == DEFAULT_RGBA[3]).all():
        return model.geom_rgba[:, 3]
    return colours(model)[:, 3]


def is_visible(model: mujoco.MjModel) -> np.ndarray:
    """Return whether each geom is drawn, (ngeom,) bool: its group is below COLLISION, and its alpha is above 0."""
    return (model.geom_group < COLLISION) & (alphas(model) > 0)
