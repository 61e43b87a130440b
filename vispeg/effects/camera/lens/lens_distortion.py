"""Lens distortion that the calibration does not know: the image warped by Brown's model, colour and depth alike.

A pixel at the distorted point shows what lies at the undistorted one: colour bilinear, depth from the nearest pixel,
so that no depth is made up between two surfaces. What lies outside the rendered image has the border's colour and no
depth. Source: Brown, Decentering distortion of lenses, 1966. Range: k1 +-0.1; what a calibration leaves is a tenth of
that.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.lens import undistort
from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.rays import rays

FAR = 10.0  # times the ray, which no image reaches


class LensDistortion(CameraEffect):
    """Lens distortion that the calibration lacks."""

    name = "lens_distortion"
    channel = "border"
    order = 40
    params = {
        "k1": Param(0.0, -0.2, 0.2, "1", start=0.05, doc="radial, with r^2; below 0 is a barrel"),
        "k2": Param(0.0, -0.05, 0.05, "1", start=0.01, doc="radial, with r^4"),
        "p1": Param(0.0, -0.02, 0.02, "1", start=0.002, doc="decentring, along y"),
        "p2": Param(0.0, -0.02, 0.02, "1", start=0.002, doc="decentring, along x"),
    }

    def image(self, state, frame, p, rng):
        import cv2

        for row in self.rows(p):
            values = tuple(float(p[k][row]) for k in ("k1", "k2", "p1", "p2"))
            key = (values, frame.K[row].tobytes(), frame.shape)
            cached = state.get(int(row))
            if cached is None or cached[0] != key:  # a lens stays as it is for an episode, so its map is kept
                cached = state[int(row)] = (key, *_map(frame.K[row], frame.shape, values))
            _, u, v = cached
            if frame.rgb is not None:
                frame.rgb[row] = cv2.remap(frame.rgb[row], u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            if frame.depth is not None:
                frame.depth[row] = cv2.remap(frame.depth[row], u, v, cv2.INTER_NEAREST, borderValue=0)


def _map(K: np.ndarray, shape: tuple[int, int], brown: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Where in the rendered image (px) each pixel of the distorted one looks; both (H, W) float32."""
    distorted = np.stack(rays(K, shape)[:2], -1).astype(float)
    ideal = undistort(distorted, (*brown, 0.0))
    ideal = np.where(
        np.isnan(ideal), FAR * distorted, ideal
    )  # beyond the lens's fold nothing is seen: outside the image
    f, c = np.array([K[0, 0], K[1, 1]]), np.array([K[0, 2], K[1, 2]])
    u, v = np.moveaxis(f * ideal + c, -1, 0).astype(np.float32)
    return u, v
