"""Depth noise: `z' = z + sigma(z) n` with `sigma(z) = sigma0 + k z^2`, n normal, new in every pixel and frame.

Along the optical axis and in metres, so it has a floor that no nearness removes and is symmetric in z. Disparity
noise (`disparity_noise`) is symmetric in 1/z and skewed in z, has no floor, and neighbours share it; k stands for its
sd / (f B) where a sensor's data sheet states metres. What would be at or behind the lens is lost. Source: Nguyen,
Izadi and Lovell, Modeling Kinect sensor noise, 3DIMPVT 2012 (1.2 mm and 1.9e-3 / m, about 0.4 m). Ranges: sigma0 0.1
to 2 mm, k 1e-3 to 1e-2 / m.
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
