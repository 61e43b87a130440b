"""Lateral jitter: each pixel reads the depth of a place N(0, sd) px beside it, in both directions.

The nearest pixel's reading, never a mean of two surfaces; rounding keeps the variance of the shift (Sheppard). Source:
Barron and Malik, Intrinsic scene properties from a single RGB-D image, CVPR 2013, and Handa et al., A benchmark for
RGB-D visual odometry, ICRA 2014, section III, with sd 0.5 px. Range: 0.3 to 0.7 px.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects._camera import CameraEffect
from vispeg.effects._field import normal


class LateralJitter(CameraEffect):
    """Ragged edges: a reading from a neighbouring pixel."""

    name = "lateral_jitter"
    order = 22
    params = {"sd": Param(0.0, 0.0, 3.0, "px", start=0.5, doc="standard deviation of the shift, each direction")}

    def image(self, state, frame, p, rng):
        if frame.depth is None:
            return
        height, width = frame.shape
        v, u = np.arange(height)[:, None], np.arange(width)
        for row in self.rows(p):
            move = np.rint(normal(rng[row], (2, height, width)) * np.float32(p["sd"][row])).astype(np.int32)
            at_v, at_u = np.clip(v + move[0], 0, height - 1), np.clip(u + move[1], 0, width - 1)
            frame.depth[row] = frame.depth[row].take(at_v * width + at_u)
