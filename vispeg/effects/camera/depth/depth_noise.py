"""Depth noise: `z' = z + sigma(z) n` with `sigma(z) = sigma0 + k z^2`, n normal, new in every pixel and frame.

This noise is in metres along the optical axis: symmetric in z, and at least sigma0 at any distance. Disparity noise
(`disparity_noise`) is symmetric in 1/z and so skewed in z, vanishes at z = 0, and is shared by neighbouring pixels. Use
k = sd / (f B) of that effect if a sensor's data sheet states metres. A pixel whose z' is not positive gets no reading.
Source: Nguyen, Izadi and Lovell, Modeling Kinect sensor noise, 3DIMPVT 2012 (1.2 mm and 1.9e-3 / m, about 0.4 m).
Ranges: sigma0 0.1 to 2 mm, k 1e-3 to 1e-2 / m.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.field import normal


class DepthNoise(CameraEffect):
    """Depth noise that grows with the squared distance."""

    name = "depth_noise"
    channel = "depth"
    order = 35
    random = True
    params = {
        "sigma0": Param(0.0, 0.0, 0.02, "m", start=0.001, doc="standard deviation at any distance"),
        "k": Param(0.0, 0.0, 0.1, "1/m", start=0.002, doc="growth of the standard deviation with the squared distance"),
    }

    def image(self, state, frame, p, rng):
        rows = self.rows(p)
        if frame.depth is None or not len(rows):
            return
        for row in rows:
            depth = frame.depth[row]
            sigma = np.float32(p["sigma0"][row]) + np.float32(p["k"][row]) * depth * depth
            out = depth + sigma * normal(rng[row], frame.shape)
            frame.depth[row] = np.where((depth > 0) & (out > 0), out, 0)
