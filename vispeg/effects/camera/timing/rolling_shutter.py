"""Rolling shutter: the rows of an image are exposed one after another, from the top down, `readout` seconds in all.

A frame's time is that of its middle row: row i of H sees the scene readout (i / (H - 1) - 1/2) later. In that time the
camera's own motion (v, w) moves a pixel of depth z by du/dt = fx (-vx / z + x vz / z + x y wx - (1 + x^2) wy + y wz)
and likewise along the other axis, where x, y are the pixel's normalised coordinates (Longuet-Higgins and Prazdny, The
interpretation of a moving retinal image, 1980). Range: 5 to 30 ms for cheap cameras, 0 for a global shutter.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.disparity import truth
from vispeg.effects.common.rays import rays


class RollingShutter(CameraEffect):
    """Rolling shutter: image rows exposed one after the other."""

    name = "rolling_shutter"
    channel = "border"
    order = 20
    params = {"readout": Param(0.0, 0.0, 0.1, "s", start=0.04, doc="from the first row's exposure to the last one's")}

    def image(self, state, frame, p, rng):
        import cv2

        if frame.velocity is None:
            return
        for row in self.rows(p):
            flow = image_flow(frame, int(row))
            height, width = frame.shape
            late = float(p["readout"][row]) * (np.arange(height, dtype=np.float32) / max(height - 1, 1) - 0.5)
            v, u = np.mgrid[:height, :width].astype(np.float32)
            u, v = u - flow[..., 0] * late[:, None], v - flow[..., 1] * late[:, None]
            if frame.rgb is not None:
                frame.rgb[row] = cv2.remap(frame.rgb[row], u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            if frame.depth is not None:
                frame.depth[row] = cv2.remap(frame.depth[row], u, v, cv2.INTER_NEAREST, borderValue=0)
            if frame.parts is not None:
                frame.parts[row] = cv2.remap(frame.parts[row], u, v, cv2.INTER_NEAREST, borderValue=0)


def image_flow(frame, row: int) -> np.ndarray:
    """Return how fast (H, W, 2) px/s the camera's own motion moves each pixel; without depth it counts as far away."""
    x, y, _ = rays(frame.K[row], frame.shape)
    near = np.zeros(frame.shape, np.float32)
    if (depth := truth(frame)) is not None:
        near = np.divide(1, depth[row], out=near, where=depth[row] > 0)
    vx, vy, vz, wx, wy, wz = (np.float32(v) for v in frame.velocity[row])
    du = (-vx + x * vz) * near + x * y * wx - (1 + x * x) * wy + y * wz
    dv = (-vy + y * vz) * near + (1 + y * y) * wx - x * y * wy - x * wz
    return np.stack([du * frame.K[row, 0, 0], dv * frame.K[row, 1, 1]], -1).astype(np.float32)
