"""Lens distortion that the calibration does not contain: colour and depth images warped by Brown's model.

A pixel at the distorted point shows what the rendered image has at the undistorted one: colour interpolated linearly,
depth from the nearest pixel, so that no depth is made up between two surfaces. Points outside the rendered image get
the colour of its border and no depth (0). Source: Brown, Decentering distortion of lenses, 1966. Typical sizes: |k1| up
to 0.1 without calibration, a tenth of that with one.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.lens import undistort
from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.rays import rays

FAR = 10.0  # factor on normalized coordinates that moves a point far outside the image


class LensDistortion(CameraEffect):
    """Lens distortion that the calibration does not contain."""

    name = "lens_distortion"
    channel = "border"
    order = 40
    params = {
        "k1": Param(0.0, -0.2, 0.2, "1", start=0.05, doc="radial, with r^2; barrel distortion if below 0"),
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
            if cached is None or cached[0] != key:  # a lens does not change in an episode, so its map is kept
                cached = state[int(row)] = (key, *_map(frame.K[row], frame.shape, values))
            _, u, v = cached
            if frame.rgb is not None:
                frame.rgb[row] = cv2.remap(frame.rgb[row], u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            if frame.depth is not None:
                frame.depth[row] = cv2.remap(frame.depth[row], u, v, cv2.INTER_NEAREST, borderValue=0)
            if frame.parts is not None:
                frame.parts[row] = cv2.remap(frame.parts[row], u, v, cv2.INTER_NEAREST, borderValue=0)


def _map(K: np.ndarray, shape: tuple[int, int], brown: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return for each pixel of the distorted image which point of the rendered one it shows: u and v, px.

    Args:
        K: (3, 3) intrinsics, px.
        shape: height and width of both images, px.
        brown: k1, k2, p1, p2.

    Returns:
        u and v, each (H, W) float32; far outside the image for pixels that the lens model cannot reach.
    """
    distorted = np.stack(rays(K, shape)[:2], -1).astype(float)
    ideal = undistort(distorted, (*brown, 0.0))
    ideal = np.where(np.isnan(ideal), FAR * distorted, ideal)  # NaN: no ideal point maps to this pixel
    f, c = np.array([K[0, 0], K[1, 1]]), np.array([K[0, 2], K[1, 2]])
    u, v = np.moveaxis(f * ideal + c, -1, 0).astype(np.float32)
    return u, v
