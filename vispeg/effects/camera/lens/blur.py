"""Blur: defocus as a Gaussian point spread of standard deviation `sigma`, applied to linear light.

Source of the shape: Pentland, A new sense for depth of field, TPAMI 9(4), 1987. Range: 0 to 2 px in the SVRC's
guide (docs/sources.md), for the image that a policy sees.
"""

from __future__ import annotations

from vispeg.core.params import Param
from vispeg.effects.common.light import LightEffect


class Blur(LightEffect):
    """Defocus: Gaussian blur of the image."""

    name = "blur"
    channel = "light"
    order = 50
    params = {"sigma": Param(0.0, 0.0, 5.0, "px", start=1.0, doc="standard deviation of a point's image")}

    def light(self, frame, p, rng):
        import cv2

        edge = cv2.BORDER_REPLICATE
        return lambda light, row: cv2.GaussianBlur(light, (0, 0), float(p["sigma"][row]), borderType=edge)
