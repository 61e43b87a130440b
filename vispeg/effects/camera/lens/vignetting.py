"""Vignetting: light falls off from the optical axis as `1 - amount (1 - cos^4 a)`, a the angle of the ray.

With amount 1 the natural law of a simple lens: cos^4 a = (1 + x^2 + y^2)^-2 at the normalised point (x, y). Beyond 1
the mount's own shading. Source: Goldman, Vignette and exposure calibration and compensation, TPAMI 32(12), 2010.
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
    params = {"amount": Param(0.0, 0.0, 1.5, "1", start=1.0, doc="of the fall-off by cos^4; 1 is a simple lens")}

    def light(self, frame, p, rng):
        import cv2

        amount = np.asarray(p["amount"], np.float32)

        def shade(light, row):
            _, _, secant = rays(frame.K[row], frame.shape)  # squared
            gain = np.maximum(1 - amount[row] * (1 - 1 / (secant * secant)), 0)
            return light * cv2.merge([gain] * 3)  # ten times as fast as to broadcast over three channels

        return shade
