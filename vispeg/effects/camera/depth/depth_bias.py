"""Depth bias: a scale error, an offset, a tilt, and the ripple of a stereo matcher that favours whole pixels.

z' = z (1 + scale) + offset + tilt_x x + tilt_y y + ripple z^2 / (f B) sin(2 pi d), with (x, y) the normalised pixel and
d = f B / z the disparity; ripple is its error in px. Source of the ripple: Grunnet-Jepsen et al., Subpixel linearity
improvement for RealSense D400 depth cameras, white paper; reported as rings on a plane (librealsense #3210). An offset
is the same at every distance; it arises if depth is counted from another plane than the camera's. In RealSense D400
datasheet 337029 depth starts at -3.7 mm from the front glass (D405). Ranges: scale +-1 %, offset 1 to 10 mm, ripple
0.02 to 0.08 px.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.disparity import PARAMS, disparity, focal_baseline
from vispeg.effects.common.rays import rays


class DepthBias(CameraEffect):
    """Systematic depth error, the same in every frame."""

    name = "depth_bias"
    channel = "depth"
    contains = ("depth_scale",)
    parts = (("scale",), ("offset",), ("tilt_x", "tilt_y"), ("ripple",))
    order = 34
    params = {
        "scale": Param(0.0, -0.1, 0.1, "1", start=0.01, doc="relative error of every distance"),
        "tilt_x": Param(0.0, -0.05, 0.05, "m", start=0.002, doc="error at 45 deg to the right"),
        "tilt_y": Param(0.0, -0.05, 0.05, "m", start=0.002, doc="error at 45 deg downwards"),
        "offset": Param(0.0, -0.05, 0.05, "m", start=0.003, doc="the same error at every distance"),
        "ripple": Param(0.0, -0.3, 0.3, "px", start=0.05, doc="error of the disparity between whole pixels"),
        **PARAMS,
    }

    def image(self, state, frame, p, rng):
        rows = self.rows(p)
        if frame.depth is None or not len(rows):
            return
        for row, fb in zip(rows, focal_baseline(p, rows)[:, 0, 0], strict=True):
            depth = frame.depth[row]
            x, y, _ = rays(frame.K[row], frame.shape)
            names = ("scale", "offset", "tilt_x", "tilt_y", "ripple")
            scale, offset, a, b, ripple = (np.float32(p[k][row]) for k in names)
            out = depth * (1 + scale) + offset
            out += a * x
            out += b * y
            if ripple:
                out += ripple / fb * (depth * depth) * np.sin(np.float32(2 * np.pi) * disparity(depth, fb))
            frame.depth[row] = np.where((depth > 0) & (out > 0), out, 0)
