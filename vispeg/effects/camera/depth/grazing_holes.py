"""Pixels without a reading, likelier on surfaces seen at a grazing angle, on dark ones and on shining ones.

A pixel is lost with probability 1 - (1 - P_grazing) (1 - P_dark) (1 - P_shine) (1 - P_blobs), where P_grazing =
grazing / (1 + exp((cos a - cos angle) / 0.04)) for an incidence a, which at 1.3 rad is a transition of 2.4 deg,
P_dark = dark max(0, 1 - Y^2 / 0.05) and P_shine = shine for Y^2 > 0.9, for the luma Y of the encoded picture, whose
square stands for linear luminance. The draw is a field correlated over `size` px, of which each frame keeps a share
`rho`: so they come as blobs that stay for a while. The form follows Sweeney et al., A supervised approach to
predicting noise in depth images, ICRA 2019; no source fixes its numbers: 0 to 15 % of an image is lost in practice.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.disparity import truth
from vispeg.effects.common.field import persistent
from vispeg.effects.common.light import LUMA
from vispeg.effects.common.rays import rays

WIDTH = 0.04  # of the transition around `angle`, in its cosine
DARK, BRIGHT = 0.05, 0.9  # squared luma below and above which a matcher finds no contrast


class GrazingHoles(CameraEffect):
    """Missing depth at grazing incidence, on dark surfaces and in highlights."""

    name = "grazing_holes"
    order = 14
    params = {
        "grazing": Param(0.0, 0.0, 1.0, "1", start=0.8, doc="chance of no reading on a surface seen edge-on"),
        "dark": Param(0.0, 0.0, 1.0, "1", start=0.5, doc="chance on a black surface"),
        "shine": Param(0.0, 0.0, 1.0, "1", start=0.3, doc="chance in a highlight"),
        "blobs": Param(0.0, 0.0, 0.3, "1", start=0.02, doc="chance at any pixel"),
        "angle": Param(1.3, 0.6, 1.5, "rad", start=1.3, shape=True, doc="incidence at half of `grazing`"),
        "size": Param(1.5, 0.0, 8.0, "px", start=1.5, shape=True, doc="length of the field's low-pass"),
        "rho": Param(0.9, 0.0, 0.99, "1", start=0.9, shape=True, doc="correlation with the previous frame"),
    }

    def image(self, state, frame, p, rng):
        import cv2

        rows = self.rows(p)
        if frame.depth is None or not len(rows):
            return
        field = persistent(state, frame, rows, rng, p["size"], p["rho"])
        for i, row in enumerate(rows):
            survival = np.full(frame.shape, np.float32(1 - p["blobs"][row]))
            if p["grazing"][row]:
                beyond = facing(frame, row) - np.float32(np.cos(p["angle"][row]))
                survival *= 1 - np.float32(p["grazing"][row]) / (1 + cv2.exp(beyond * np.float32(1 / WIDTH)))
            if frame.rgb is not None and (p["dark"][row] or p["shine"][row]):
                luma = cv2.transform(frame.rgb[row], LUMA[None])
                light = luma * luma  # to the accuracy that matters here, sRGB is a square
                survival *= 1 - np.float32(p["dark"][row]) * np.maximum(0, 1 - light * np.float32(1 / DARK))
                survival *= 1 - np.float32(p["shine"][row]) * (light > np.float32(BRIGHT))
            frame.depth[row] *= _normal_cdf(field[i]) <= survival


def facing(frame, row: int) -> np.ndarray:
    """Cosine (H, W) of the angle between a surface's normal and the ray that sees it, of one image; 1 where nothing is.

    Without normals from the renderer they follow from planar depth z(u, v): for the point z (x, y, 1) the tangents'
    cross product gives cos a = z / (|n| sqrt(1 + x^2 + y^2)) with n = (fx zu, fy zv, z + (u - cx) zu + (v - cy) zv).
    The smaller of the two one-sided differences stands for zu and zv, so that an edge is not taken for a slope.
    """
    x, y, secant = rays(frame.K[row], frame.shape)  # squared
    if frame.normals is not None:
        n = frame.normals[row]
        cos = -(n[..., 0] * x + n[..., 1] * y + n[..., 2]) / np.sqrt(secant)
        return np.clip(np.where(np.any(n, axis=-1), cos, 1), 0, 1)
    z = truth(frame)[row]
    a = np.float32(frame.K[row, 0, 0]) * _slope(z)
    b = np.float32(frame.K[row, 1, 1]) * _slope(z.T).T
    c = z + a * x + b * y
    length = np.sqrt((a * a + b * b + c * c) * secant)
    return np.divide(z, length, out=np.ones_like(z), where=z > 0)


def _slope(z: np.ndarray) -> np.ndarray:
    """Difference (H, W) to a neighbour along the last axis, per px: the smaller of the two in size."""
    step = np.empty((len(z), z.shape[1] + 1), z.dtype)
    np.subtract(z[:, 1:], z[:, :-1], out=step[:, 1:-1])
    step[:, 0], step[:, -1] = step[:, 1], step[:, -2]
    size = np.abs(step)
    return np.where(size[:, :-1] < size[:, 1:], step[:, :-1], step[:, 1:])


def _normal_cdf(x: np.ndarray) -> np.ndarray:
    """Give the standard normal distribution function, to 2e-4: Page, Approximations to the cumulative normal, 1977."""
    import cv2

    return 1 / (1 + cv2.exp(-x * (np.float32(1.5976) + np.float32(0.070566) * x * x)))
