"""A copy of the model fields that a look or an episode's placement of bodies may change, to restore them."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

PREFIXES = ("geom_", "mat_", "light_", "cam_", "tex_data", "body_pos", "body_quat")
BELOW = tuple(f"vis.headlight.{x}" for x in ("ambient", "diffuse", "specular"))  # below the top level


def place(model: mujoco.MjModel, name: str) -> np.ndarray:
    """Return a view of a model's array by name; names such as `vis.headlight.ambient` reach below the top level."""
    value = model
    for part in name.split("."):
        value = getattr(value, part)
    return np.asarray(value)


class Pristine:
    """A copy of all model fields that affect images: looks, cameras and the poses of bodies in their parents.

    `restore` writes them back. The copy takes about half a megabyte for the cell.
    """

    def __init__(self, model: mujoco.MjModel):
        self._kept = {name: array.copy() for name, array in _visual(model)}

    def restore(self, model: mujoco.MjModel) -> None:
        """Write the copied fields back to `model`, bit for bit."""
        for name, array in self._kept.items():
            place(model, name)[...] = array


def _visual(model: mujoco.MjModel) -> Iterator[tuple[str, np.ndarray]]:
    for name in (*(n for n in dir(model) if n.startswith(PREFIXES)), *BELOW):
        array = place(model, name)
        if array.dtype != object and array.size:
            yield name, array
