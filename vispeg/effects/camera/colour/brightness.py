"""Brightness: encoded colour values are scaled, `v (1 + change)`, and clipped at white, as image editors do it.

This gain acts on the finished image; `exposure` scales the light. Range: +-30 % in the SVRC's guide
(docs/sources.md).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect


class Brightness(CameraEffect):
    """Relative change of all encoded colour values."""

    name = "brightness"
    order = 62
    photometric = True
    params = {"change": Param(0.0, -0.8, 0.8, "1", start=0.2, doc="relative change of all encoded values")}

    def image(self, state, frame, p, rng):
        if frame.rgb is None:
            return
        for row in self.rows(p):
            rgb = frame.rgb[row] * np.float32(1 + p["change"][row])
            np.clip(rgb, 0, 1, out=frame.rgb[row])
