"""Depth scale: every distance times one factor, `z' = factor z`, as a wrong baseline or focal length makes it.

A depth camera finds a disparity d and reports z = f B / d. If its true focal length and baseline are f and B but its
calibration says f' and B', then z' / z = (f' B') / (f B) at every pixel: the same factor near and far, which no
averaging removes. Source: Gallup, Frahm, Mordohai and Pollefeys, CVPR 2008, eq. (1). Range: 1 to 2 % after a fall or a
change of temperature. The parameter `scale` of `depth_bias` is the same error.
"""

from __future__ import annotations

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect, column


class DepthScale(CameraEffect):
    """Scale error of all depths."""

    name = "depth_scale"
    channel = "depth"
    part_of = ("depth_bias", "scale")
    order = 33
    told_from = {"depth_bias": "a flat part at distances that differ by a factor of two"}
    params = {"factor": Param(1.0, 0.8, 1.25, "1", start=1.02, scale="log", doc="factor on every depth")}

    def image(self, state, frame, p, rng):
        rows = self.rows(p)
        if frame.depth is not None and len(rows):
            frame.depth[rows] *= column(p["factor"], rows, 2)
