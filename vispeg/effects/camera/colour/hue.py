"""Hue: every colour is rotated on the colour circle by `turn`; value and saturation stay.

Colours are in the hexagonal HSV of Smith, Color gamut transform pairs, SIGGRAPH 1978. Range: +-20 % of a turn in
the SVRC's guide (docs/sources.md).
"""

from __future__ import annotations

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect


class Hue(CameraEffect):
    """Rotation of the hue."""

    name = "hue"
    order = 66
    photometric = True
    params = {"turn": Param(0.0, -0.5, 0.5, "turns", start=0.1, doc="rotation; red to green is a third of a turn")}

    def image(self, state, frame, p, rng):
        import cv2

        if frame.rgb is None:
            return
        for row in self.rows(p):
            hsv = cv2.cvtColor(frame.rgb[row], cv2.COLOR_RGB2HSV)  # degrees, then two values in [0, 1]
            hue = hsv[..., 0] + 360.0 * float(p["turn"][row])
            hue -= 360.0 * (hue >= 360.0)
            hue += 360.0 * (hue < 0.0)
            hsv[..., 0] = hue
            frame.rgb[row] = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB).clip(0, 1)
