"""Lost depth readings: likelier at grazing incidence, on dark surfaces and in highlights.

A pixel is lost with probability 1 - (1 - P_grazing) (1 - P_dark) (1 - P_shine) (1 - P_blobs). At incidence a, P_grazing
= grazing / (1 + exp((cos a - cos angle) / 0.04)); with `angle` 1.3 rad, the width 0.04 of the transition is 2.4 deg.
P_dark = dark max(0, 1 - Y^2 / 0.05), and P_shine = shine if Y^2 > 0.9, with the luma Y of the encoded image, whose
square approximates linear luminance. P_blobs = blobs. The random numbers are a field that is correlated over `size` px
and of which each frame keeps a share `rho`, so lost pixels form blobs that last for some frames. The form follows
Sweeney et al., A supervised approach to predicting noise in depth images, ICRA 2019; no source states its numbers. In
practice 0 to 15 % of an image is lost.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.disparity import truth
from vispeg.effects.common.field import persistent
from vispeg.effects.common.light import LUMA, colour
from vispeg.effects.common.rays import rays

WIDTH = 0.04  # width of the transition around `angle`, in the cosine
DARK, BRIGHT = 0.05, 0.9  # squared luma below and above which a matcher finds no contrast


class GrazingHoles(CameraEffect):
    """Missing depth at grazing incidence, on dark surfaces and in highlights."""

    name = "grazing_holes"
    order = 14
    random = True
    params = {
        "grazing": Param(0.0, 0.0, 1.0, "1", start=0.8, doc="chance of no reading on a surface seen edge-on"),
        "dark": Param(0.0, 0.0, 1.0, "1", start=0.5, doc="chance of no reading on a black surface"),
        "shine": Param(0.0, 0.0, 1.0, "1", start=0.3, doc="chance of no reading in a highlight"),
        "blobs": Param(0.0, 0.0, 0.3, "1", start=0.02, doc="chance of no reading at any pixel"),
        "angle": Param(1.3, 0.6, 1.5, "rad", start=1.3, shape=True, doc="incidence with half the chance `grazing`"),
        "size": Param(1.5, 0.0, 8.0, "px", start=1.5, shape=True, doc="low-pass length of the random field"),
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
            if (rgb := colour(frame)) is not None and (p["dark"][row] or p["shine"][row]):
                luma = cv2.transform(rgb[row], LUMA[None])
                light = luma * luma  # approximates the decoding of sRGB well enough here
                survival *= 1 - np.float32(p["dark"][row]) * np.maximum(0, 1 - light * np.float32(1 / DARK))
                survival *= 1 - np.float32(p["shine"][row]) * (light > np.float32(BRIGHT))
            frame.depth[row] *= _normal_cdf(field[i]) <= survival


def facing(frame, row: int) -> np.ndarray:
    """Return the cosine (H, W) of the incidence a in image `row`: between surface normal and ray; 1 without a surface.

    If the renderer gives no normals, planar depth z(u, v) does: for the point z (x, y, 1) the tangents' cross product
    gives cos a = z / (|n| sqrt(1 + x^2 + y^2)) with n = (fx zu, fy zv, z + (u - cx) zu + (v - cy) zv). The smaller of
    the two one-sided differences stands for zu = dz/du and zv = dz/dv, so that an edge is not taken for a slope.
    """
    x, y, secant = rays(frame.K[row], frame.shape)  # the last is the squared secant of the ray's angle
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
    """Return the differences (H, W) of z to its neighbours along the last axis, per px: the smaller in size of two."""
    step = np.empty((len(z), z.shape[1] + 1), z.dtype)
    np.subtract(z[:, 1:], z[:, :-1], out=step[:, 1:-1])
    step[:, 0], step[:, -1] = step[:, 1], step[:, -2]
    size = np.abs(step)
    return np.where(size[:, :-1] < size[:, 1:], step[:, :-1], step[:, 1:])


def _normal_cdf(x: np.ndarray) -> np.ndarray:
    """Return the normal distribution function, to 2e-4: Page, Approximations to the cumulative normal, 1977."""
    import cv2

    return 1 / (1 + cv2.exp(-x * (np.float32(1.5976) + np.float32(0.070566) * x * x)))
