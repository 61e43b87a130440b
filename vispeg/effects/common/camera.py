"""Base of the `camera` effects: where they act, and in which images of a stack."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import mujoco
import numpy as np

from vispeg.core.effect import Effect, Values

LOOK_FAST = "look-fast: fast motion up and down the image, both ways"  # motion that shows an effect of time
DELIVERED = ("rgb", "depth", "shown")  # fields of a Frame that are delivered late if a camera is late


class CameraEffect(Effect):
    """A fault of a camera. It has no target on a bare robot, which has no camera.

    Class attributes:
        moving: parameters with which it needs to know which bodies an image shows, and how the camera moves relative to
            them.
        photometric: True if it changes only each pixel's colour, on its own and in the same way in every frame.
        random: True if it is drawn anew in each frame or episode, so that no picture can be predicted with it.
        parts: groups of parameters, each of which is a fault by itself, without the others.
        part_of: an effect of which this one is a special case, and the parameter there that is the same.
        channel: the channel of images in which a diagnosis searches it: `border`, `depth` or `light`; empty for none.
    """

    family = "camera"
    moving: ClassVar[tuple[str, ...]] = ()
    photometric: ClassVar[bool] = False
    random: ClassVar[bool] = False
    parts: ClassVar[tuple[tuple[str, ...], ...]] = ()
    part_of: ClassVar[tuple[str, str] | None] = None
    channel: ClassVar[str] = ""

    def targets(self, model: Any) -> list[str]:
        return list(model.cameras) if getattr(model, "parts", None) else []

    def channels(self) -> frozenset[str]:
        return frozenset({self.channel} - {""})

    def moved(self, fields: Any, p: Values) -> Iterator[tuple[int, int, dict[str, float]]]:
        """Yield the simulation's row, the camera's id and the values, for cameras of the model with this effect."""
        for column, name in enumerate(fields.scene.cameras):
            camera = mujoco.mj_name2id(fields.model, mujoco.mjtObj.mjOBJ_CAMERA, name)
            if camera < 0:
                continue
            here = {k: np.asarray(v)[:, column] for k, v in p.items()}
            for row in self.rows(here):
                yield int(row), camera, {k: float(v[row]) for k, v in here.items()}

    def rows(self, p: Values) -> np.ndarray:
        """Return the indices of the images with the effect: those in which a magnitude differs from null."""
        first, *others = self.magnitudes
        at_work = np.asarray(p[first]) != self.params[first].null
        for name in others:
            at_work = at_work | (np.asarray(p[name]) != self.params[name].null)
        return at_work.nonzero()[0]


def column(values: np.ndarray, rows: np.ndarray, axes: int) -> np.ndarray:
    """Return the values of these images as float32, with `axes` trailing axes of length 1 to broadcast over pixels."""
    return np.asarray(values, np.float32)[rows].reshape(-1, *(1,) * axes)
