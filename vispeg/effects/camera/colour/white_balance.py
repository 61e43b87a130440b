"""White balance: gains of the red and the blue channel against green, in linear light.

The diagonal model of von Kries, as in every camera's image processor. Range: gains 0.8 to 1.25.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.light import LightEffect


class WhiteBalance(LightEffect):
    """White balance: gains of red and blue."""

    name = "white_balance"
    channel = "light"
    order = 60
    photometric = True
    params = {
        "red": Param(1.0, 0.4, 2.5, "1", start=1.15, scale="log", doc="gain of red"),
        "blue": Param(1.0, 0.4, 2.5, "1", start=0.9, scale="log", doc="gain of blue"),
    }

    def light(self, frame, p, rng):
        height, width = frame.shape
        gains = np.stack([p["red"], np.ones(frame.n), p["blue"]], axis=1).astype(np.float32)  # (n, 3)
        lines = np.tile(gains, width)  # (n, 3 W): one line of the image
        return lambda light, row: (light.reshape(height, -1) * lines[row]).reshape(light.shape)
