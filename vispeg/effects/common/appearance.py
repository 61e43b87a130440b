"""What looks have in common: where they act, and how they reach materials and textures of a compiled scene."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from vispeg.core.effect import Effect

SEEDS = 2.0**31 - 1  # a seed parameter lies in 0..SEEDS and is cut to a whole number


class PartLook(Effect):
    """A look of parts that have a material and a texture of their own."""

    family = "appearance"

    def targets(self, model: Any) -> list[str]:
        """Every part but the arm, whose links keep the colours of its own description."""
        return [part for part in getattr(model, "dressed", ()) if part != "arm"]


class LightLook(Effect):
    """A look of single lights."""

    family = "appearance"

    def targets(self, model: Any) -> list[str]:
        """Give the scene's lights."""
        return list(getattr(model, "lights", ()))


class SceneLook(Effect):
    """A look of the scene as a whole."""

    family = "appearance"

    def targets(self, model: Any) -> list[str]:
        """`scene`, the only place there is, where its parts can be dressed."""
        return ["scene"] if getattr(model, "dressed", ()) else []


def at(names: list[str], weight: np.ndarray) -> Iterator[tuple[int, int, str]]:
    """(row, column, name) of every place where `weight` (nsim, len(names)) is not 0."""
    for row, column in np.argwhere(weight != 0):
        yield int(row), int(column), names[column]


def pixels(fields: Any, row: int, texture: str) -> np.ndarray:
    """View (h, w, channels) uint8 of a texture's pixels; writing to it changes the texture."""
    model = fields.model
    i = model.texture(texture).id
    shape = int(model.tex_height[i]), int(model.tex_width[i]), int(model.tex_nchannel[i])
    start = int(model.tex_adr[i])
    return fields["tex_data"][row].reshape(-1)[start : start + int(np.prod(shape))].reshape(shape)


def blend(below: np.ndarray, above: np.ndarray, amount: float) -> np.ndarray:
    """`below` uint8 with `amount` of `above` (in [0, 1], sRGB) over it, uint8."""
    mixed = (1 - amount) * below.astype(np.float32) + amount * 255 * above
    return np.clip(np.rint(mixed), 0, 255).astype(np.uint8)
