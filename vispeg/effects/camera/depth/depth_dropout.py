"""Depth dropout: a `share` of the pixels gives no reading, drawn anew in every frame, in blobs `size` px wide.

A pixel is lost where a Gaussian field of variance 1 is below u, the quantile of `share`. Smoothed by a Gaussian of
standard deviation L px, the field crosses u upwards exp(-u^2 / 2) / (2 pi sqrt(2) L) times per px along a line, so the
mean run of lost pixels is share 2 pi sqrt(2) L exp(u^2 / 2) px, from which L follows for a given `size`. Below about 2
px runs are longer than `size`, because pixels are discrete: independent pixels already come in runs of 1 / (1 - share).
Source: Rice, Mathematical analysis of random noise, Bell System Technical Journal 24, 1945, section 3.3. Range: 0 to 15
% of an image. Not modelled: real dropouts depend on the surface and persist from frame to frame.
"""

from __future__ import annotations

import math

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.field import correlated


class DepthDropout(CameraEffect):
    """Missing depth readings at random pixels, new in every frame."""

    name = "depth_dropout"
    channel = "depth"
    order = 36
    random = True
    params = {
        "share": Param(0.0, 0.0, 0.5, "1", start=0.05, doc="share of pixels without a reading"),
        "size": Param(3.0, 0.0, 12.0, "px", start=3.0, shape=True, doc="mean run of lost pixels in a row"),
    }

    def image(self, state, frame, p, rng):
        from scipy.special import ndtri

        rows = self.rows(p)
        if frame.depth is None or not len(rows):
            return
        for row in rows:
            share, size = float(p["share"][row]), float(p["size"][row])
            level = float(ndtri(share))
            length = size / (share * math.tau * math.sqrt(2) * math.exp(0.5 * level**2))
            frame.depth[row] *= correlated(rng[row], frame.shape, length) >= level
