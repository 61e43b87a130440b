"""Base classes of the `appearance` effects, and access to the textures of a compiled scene."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np

from vispeg.core.effect import Effect


class PartLook(Effect):
    """An appearance effect of parts that have a material and a texture of their own.

    Class attributes:
        images: file name endings of the images that it draws from; empty for none.
    """

    images: ClassVar[tuple[str, ...]] = ()
    family = "appearance"

    def targets(self, model: Any) -> list[str]:
        """Return every part with a material except the arm, whose links have the colours of its description."""
        return [part for part in getattr(model, "dressed", ()) if part != "arm"]


class LightLook(Effect):
    """An appearance effect of single lights."""

    family = "appearance"

    def targets(self, model: Any) -> list[str]:
        """Return the scene's lights."""
        return list(getattr(model, "lights", ()))


class SceneLook(Effect):
    """An appearance effect of the scene as a whole; `images` as for PartLook."""

    images: ClassVar[tuple[str, ...]] = ()
    family = "appearance"

    def targets(self, model: Any) -> list[str]:
        """Return `scene`, the only target, if the scene has parts with materials."""
        return ["scene"] if getattr(model, "dressed", ()) else []


def where_nonzero(names: list[str], weight: np.ndarray) -> Iterator[tuple[int, int, str]]:
    """Yield (row, column, name) of every place where `weight` (nsim, len(names)) is not 0."""
    for row, column in np.argwhere(weight != 0):
        yield int(row), int(column), names[column]


def pixels(fields: Any, row: int, texture: str) -> np.ndarray:
    """Return a view (h, w, channels) uint8 of a texture's pixels; writing to it changes the texture."""
    model = fields.model
    i = model.texture(texture).id
    shape = int(model.tex_height[i]), int(model.tex_width[i]), int(model.tex_nchannel[i])
    start = int(model.tex_adr[i])
    return fields["tex_data"][row].reshape(-1)[start : start + int(np.prod(shape))].reshape(shape)


def blend(below: np.ndarray, above: np.ndarray, amount: float) -> np.ndarray:
    """Return the mean, uint8, of `below` (uint8) and `above` (in [0, 1], sRGB), with weight `amount` for `above`."""
    mixed = (1 - amount) * below.astype(np.float32) + amount * 255 * above
    return np.clip(np.rint(mixed), 0, 255).astype(np.uint8)
