"""Exposure: the light on the sensor is scaled by `2^stops` and clipped where the sensor saturates.

Range: `stops` of -0.7 to 0.7, the differences between scenes that an automatic exposure leaves.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.light import LightEffect


class Exposure(LightEffect):
    """Exposure: scale of the light on the sensor."""

    name = "exposure"
    channel = "light"
    order = 56
    photometric = True
    params = {"stops": Param(0.0, -4.0, 4.0, "stops", start=0.5, doc="doublings of the light")}

    def light(self, frame, p, rng):
        gain = np.exp2(p["stops"]).astype(np.float32)
        return lambda light, row: np.minimum(light * gain[row], 1)  # saturation
