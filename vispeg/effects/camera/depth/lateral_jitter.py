"""Lateral jitter: each pixel reads the depth at a place N(0, sd) px away, along both axes of the image.

The shift is rounded to whole pixels, so that no reading is a mean of two surfaces. From sd 0.5 px on, rounding adds
1 / 12 px^2 to the variance (Sheppard). Smaller shifts are mostly rounded to 0: 38 % of the pixels read another pixel at
0.4 px, 18 % at 0.3, 2.5 % at 0.2, none below 0.116. Source: Barron and Malik, Intrinsic scene properties from a single
RGB-D image, CVPR 2013, and Handa et al., A benchmark for RGB-D visual odometry, ICRA 2014, section III, with sd 0.5 px.
Range: 0.3 to 0.7 px.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.field import normal


class LateralJitter(CameraEffect):
    """Depth readings from neighbouring pixels: ragged edges."""

    name = "lateral_jitter"
    order = 22
    random = True
    params = {"sd": Param(0.0, 0.0, 3.0, "px", start=0.5, doc="standard deviation of the shift along each axis")}

    def image(self, state, frame, p, rng):
        import cv2

        if frame.depth is None:
            return
        height, width = frame.shape
        for row in self.rows(p):
            sd = float(p["sd"][row])
            r = int(np.ceil(5 * sd))  # px, wide enough, as no number of `normal` exceeds 4.3
            wide = cv2.copyMakeBorder(frame.depth[row], r, r, r, r, cv2.BORDER_REPLICATE)
            move = np.rint(normal(rng[row], (2, height, width)) * np.float32(sd)).astype(np.int32)
            frame.depth[row] = wide.take(move[0] * np.int32(wide.shape[1]) + move[1] + _places(height, width, r))


@lru_cache(maxsize=256)
def _places(height: int, width: int, border: int) -> np.ndarray:
    """Return the flat indices (height, width) of an image's pixels in the image that has a border around it."""
    v, u = np.arange(height)[:, None] + border, np.arange(width) + border
    return (v * (width + 2 * border) + u).astype(np.int32)
