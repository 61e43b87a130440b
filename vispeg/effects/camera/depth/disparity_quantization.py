"""Disparity quantization: a stereo matcher's disparity is rounded to a step, `d = step round(d / step)`.

Depth then comes in steps of step z^2 / (f B), wider with distance; where d rounds to 0 there is none. Source: Handa
et al., A benchmark for RGB-D visual odometry, ICRA 2014, section III (1/8 px). Range: 1/32 to 1/8 px.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect, column
from vispeg.effects.common.disparity import PARAMS, disparity, focal_baseline


class DisparityQuantization(CameraEffect):
    """Quantized disparity: depth in steps."""

    name = "disparity_quantization"
    order = 32
    smooth = False
    params = {
        "step": Param(0.0, 0.0, 1.0, "px", start=0.0625, doc="step of the disparity, at the native size"),
        **PARAMS,
    }

    def image(self, state, frame, p, rng):
        rows = self.rows(p)
        if frame.depth is None or not len(rows):
            return
        fb, step = focal_baseline(p, rows), column(p["step"], rows, 2)
        d = np.rint(disparity(frame.depth[rows], fb) / step) * step
        frame.depth[rows] = np.divide(fb, d, out=np.zeros_like(d), where=d > 0)
