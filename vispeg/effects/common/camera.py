"""Base of the `camera` effects: where they act, and in which images of a stack."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import mujoco
import numpy as np

from vispeg.core.effect import Effect, Values
from vispeg.core.params import Param

SEED_MAX = float(2**31 - 1)
DELIVERED = ("rgb", "depth", "shown")  # what of a Frame is delivered later where a camera is late


class CameraEffect(Effect):
    """A fault of a camera. A bare robot carries none, so it has no target there."""

    family = "camera"
    photometric: ClassVar[bool] = False  # only turns each pixel's colour into another, the same way in every frame
    parts: ClassVar[tuple[tuple[str, ...], ...]] = ()  # parameters that are a fault by themselves, without the others
    part_of: ClassVar[tuple[str, str] | None] = None  # the effect that has this one as a part, and its parameter there
    channel: ClassVar[str] = ""  # of pictures, in which a diagnosis looks for it: `border`, `depth`, `light`; or none

    def targets(self, model: Any) -> list[str]:
        return list(model.cameras) if getattr(model, "parts", None) else []

    def channels(self) -> frozenset[str]:
        return frozenset({self.channel} - {""})

    def moved(self, fields: Any, p: Values) -> Iterator[tuple[int, int, dict[str, float]]]:
        """Row of the batch, camera of the model and values, where the effect is at work on a camera there is."""
        for column, name in enumerate(fields.scene.cameras):
            camera = mujoco.mj_name2id(fields.model, mujoco.mjtObj.mjOBJ_CAMERA, name)
            here = {k: np.asarray(v)[:, column] for k, v in p.items()}
            for row in self.rows(here) if camera >= 0 else ():
                yield int(row), camera, {k: float(v[row]) for k, v in here.items()}

    def rows(self, p: Values) -> np.ndarray:
        """Give the indices of the images in which some magnitude is away from null; only those are touched."""
        at_work = [np.asarray(p[name]) != self.params[name].null for name in self.magnitudes]
        return np.flatnonzero(np.any(at_work, axis=0))


def seed_param(doc: str) -> Param:
    """Give a shape parameter that picks one of the random forms an effect can take, so that a drawn world replays."""
    return Param(0.0, 0.0, SEED_MAX, "1", start=0.0, shape=True, doc=doc)


def column(values: np.ndarray, rows: np.ndarray, axes: int) -> np.ndarray:
    """Values of some images as float32, with `axes` trailing axes of length 1 to broadcast over their pixels."""
    return np.asarray(values, np.float32)[rows].reshape(-1, *(1,) * axes)
