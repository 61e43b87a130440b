"""Exposure: all light scaled by `2^stops` before the sensor, cut where it is full.

Photographic stops: one doubles the light. Range: 2^U(-0.7, 0.7) is what an automatic exposure leaves between scenes.
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
        return lambda light, row: np.minimum(light * gain[row], 1)  # a full well
