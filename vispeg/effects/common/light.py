"""The sRGB transfer curve in both directions, and effects on linear light. Encoded values do not add as light does.

Source: IEC 61966-2-1:1999, sections 5.2 and 5.3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vispeg.core.effect import Values
from vispeg.core.frame import Frame
from vispeg.effects.common.camera import CameraEffect

LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)  # ITU-R BT.709


def to_linear(rgb: np.ndarray) -> np.ndarray:
    """Decode sRGB values in [0, 1], any shape, to linear light in [0, 1], float32."""
    import cv2

    out = cv2.pow(np.ravel(rgb) * np.float32(1 / 1.055) + np.float32(0.055 / 1.055), 2.4).reshape(rgb.shape)
    np.multiply(rgb, np.float32(1 / 12.92), out=out, where=rgb <= np.float32(0.04045))
    return out


def to_srgb(light: np.ndarray) -> np.ndarray:
    """Encode linear light as sRGB values, float32; light is clipped to [0, 1] first, as a sensor does."""
    import cv2

    light = np.clip(light, 0, 1, dtype=np.float32)
    out = cv2.pow(np.ravel(light), 1 / 2.4).reshape(light.shape)
    out *= np.float32(1.055)
    out -= np.float32(0.055)
    np.multiply(light, np.float32(12.92), out=out, where=light <= np.float32(0.0031308))
    return np.minimum(out, np.float32(1), out=out)


def colour(frame: Frame) -> np.ndarray | None:
    """Return the frame's `colour` (n, H, W, 3), which no effect changes, else its `rgb`; None if it has neither."""
    return frame.rgb if frame.colour is None else frame.colour


Through = Callable[[np.ndarray, int], np.ndarray]  # (light (H, W, 3), index of the image) -> changed light


class LightEffect(CameraEffect):
    """A fault that acts on linear light, image by image. An image is decoded once for several such effects in a row."""

    def light(self, frame: Frame, p: Values, rng: Sequence[np.random.Generator]) -> Through:
        """Return a function that changes the light of one image of the frame; its result may leave [0, 1]."""
        raise NotImplementedError

    def image(self, state, frame, p, rng):
        pass_light([(self, p, rng)], frame)


def pass_light(chain: Sequence[tuple[LightEffect, Values, Sequence[np.random.Generator]]], frame: Frame) -> None:
    """Apply several effects to the images of a frame, to each image those that are present in it."""
    if frame.rgb is None:
        return
    rows = [set(kind.rows(p).tolist()) for kind, p, _ in chain]
    through = [kind.light(frame, p, rng) for kind, p, rng in chain]
    for row in sorted(set().union(*rows)):
        light = to_linear(frame.rgb[row])
        for at_work, change in zip(rows, through, strict=True):
            light = change(light, row) if row in at_work else light
        frame.rgb[row] = to_srgb(light)
