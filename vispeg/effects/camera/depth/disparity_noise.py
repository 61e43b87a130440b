"""Disparity noise: d = f B / z + sd n, so depth scatters by sd z^2 / (f B), with the square of the distance.

n is white noise low-passed over `length` px, since neighbours share most of their matching window. Source: Gallup,
Frahm, Mordohai and Pollefeys, CVPR 2008, eq. (2); Khoshelham and Elberink, Sensors 12(2), 2012, eq. (11). Range: sd
0.05 to 0.25 px of the matcher's image, length 1 to 4 px.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect, column
from vispeg.effects.common.disparity import PARAMS, displaced, focal_baseline
from vispeg.effects.common.field import correlated


class DisparityNoise(CameraEffect):
    """Disparity noise, new in every frame: depth noise grows with the squared distance."""

    name = "disparity_noise"
    order = 26
    random = True
    params = {
        "sd": Param(0.0, 0.0, 2.0, "px", start=0.1, doc="standard deviation of the disparity, at the native size"),
        "length": Param(1.0, 0.0, 6.0, "px", start=1.0, shape=True, doc="low-pass length in the image"),
        **PARAMS,
    }

    def image(self, state, frame, p, rng):
        rows = self.rows(p)
        if frame.depth is None or not len(rows):
            return
        noise = np.stack([correlated(rng[row], frame.shape, float(p["length"][row])) for row in rows])
        frame.depth[rows] = displaced(frame.depth[rows], column(p["sd"], rows, 2) * noise, focal_baseline(p, rows))
