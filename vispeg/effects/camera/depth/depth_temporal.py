"""Lasting depth errors: disparity noise that is correlated over frames, e <- rho e + sqrt(1 - rho^2) sd n.

n is new noise of variance 1. The error e has standard deviation sd in every frame and correlation rho^k over k frames,
so a policy cannot average it away as it can `disparity_noise`. Ranges: rho 0.5 to 0.9, from the temporal filters of
stereo cameras; sd as in `disparity_noise`.
"""

from __future__ import annotations

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect, column
from vispeg.effects.common.disparity import PARAMS, displaced, focal_baseline
from vispeg.effects.common.field import persistent


class DepthTemporal(CameraEffect):
    """Disparity noise correlated over frames."""

    name = "depth_temporal"
    order = 28
    random = True
    params = {
        "sd": Param(0.0, 0.0, 2.0, "px", start=0.08, doc="standard deviation of the disparity, at the native size"),
        "rho": Param(0.7, 0.0, 0.99, "1", start=0.7, shape=True, doc="correlation with the previous frame"),
        "length": Param(2.0, 0.0, 6.0, "px", start=2.0, shape=True, doc="low-pass length in the image"),
        **PARAMS,
    }

    def image(self, state, frame, p, rng):
        rows = self.rows(p)
        if frame.depth is None or not len(rows):
            return
        noise = persistent(state, frame, rows, rng, p["length"], p["rho"])
        frame.depth[rows] = displaced(frame.depth[rows], column(p["sd"], rows, 2) * noise, focal_baseline(p, rows))
