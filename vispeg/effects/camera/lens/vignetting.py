"""Vignetting: light falls off from the optical axis as `1 - amount (1 - cos^4 a)`, where a is the angle of the ray.

Amount 1 is the natural fall-off of a simple lens: cos^4 a = (1 + x^2 + y^2)^-2 at the normalised point (x, y). Above 1
the lens mount shades too. Source: Goldman, Vignette and exposure calibration and compensation, TPAMI 32(12), 2010.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.light import LightEffect
from vispeg.effects.common.rays import rays


class Vignetting(LightEffect):
    """Vignetting: darker corners."""

    name = "vignetting"
    channel = "light"
    order = 52
    photometric = True
    params = {"amount": Param(0.0, 0.0, 1.5, "1", start=1.0, doc="strength of the cos^4 fall-off; 1: simple lens")}

    def light(self, frame, p, rng):
        import cv2

        amount = np.asarray(p["amount"], np.float32)

        def shade(light, row):
            _, _, secant = rays(frame.K[row], frame.shape)  # 1 / cos^2 a
            gain = np.maximum(1 - amount[row] * (1 - 1 / (secant * secant)), 0)
            return light * cv2.merge([gain] * 3)  # ten times as fast as broadcasting over the channels

        return shade
