"""Near limit: nothing nearer than `nearest` is measured.

A stereo matcher looks for disparities up to d_max only, so z_min = f B / d_max: 0.17 m for f = 425 px, B = 50 mm,
d_max = 126 px. Source: Intel RealSense D400 series datasheet 337029, minimum-Z of each resolution.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect, column
from vispeg.effects.common.disparity import truth


class NearLimit(CameraEffect):
    """Least distance that a depth camera measures."""

    name = "near_limit"
    order = 12
    shown_by = ("an approach to 0.1 m and nearer",)
    params = {"nearest": Param(0.0, 0.0, 1.0, "m", start=0.15, doc="least planar distance that is measured")}

    def image(self, state, frame, p, rng):
        rows = self.rows(p)
        if frame.depth is not None and len(rows):
            near = truth(frame)[rows] < column(p["nearest"], rows, 2)
            frame.depth[rows] = np.where(near, 0, frame.depth[rows])
