"""Saturation: colours v move towards the grey of their luma g or away from it, `g + (1 + change) (v - g)`.

Grey pixels do not change. The luma (ITU-R BT.709) stays too, unless a channel is clipped at black or white. Range:
+-15 % in the SVRC's guide (docs/sources.md).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.light import LUMA


class Saturation(CameraEffect):
    """Change of the colour saturation."""

    name = "saturation"
    order = 64
    photometric = True
    params = {"change": Param(0.0, -1.0, 1.0, "1", start=0.15, doc="relative change; -1 is a grey picture")}

    def image(self, state, frame, p, rng):
        import cv2

        if frame.rgb is None:
            return
        for row in self.rows(p):
            change = float(p["change"][row])
            matrix = (1 + change) * np.eye(3) - change * np.tile(LUMA, (3, 1))
            np.clip(cv2.transform(frame.rgb[row], matrix), 0, 1, out=frame.rgb[row])
