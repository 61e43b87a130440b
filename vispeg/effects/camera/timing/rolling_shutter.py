"""Rolling shutter: the rows of an image are exposed one after another, from the top down, `readout` seconds in all.

A frame's time is that of its middle row: row i of H sees the scene readout (i / (H - 1) - 1/2) later. In that time each
pixel moves as `vispeg.effects.common.image_motion` says. What is carried with the camera stays; where two surfaces
arrive, the nearer one is seen. Range: 5 to 30 ms for cheap cameras, 0 for a global shutter.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import LOOK_FAST, CameraEffect
from vispeg.effects.common.image_motion import arriving, image_flow, nearness


class RollingShutter(CameraEffect):
    """Rolling shutter: image rows exposed one after the other."""

    name = "rolling_shutter"
    channel = "border"
    order = 20
    moving = ("readout",)
    shown_by = (LOOK_FAST,)
    params = {"readout": Param(0.0, 0.0, 0.1, "s", start=0.04, doc="from the first row's exposure to the last one's")}

    def image(self, state, frame, p, rng):
        import cv2

        if frame.velocity is None:
            return
        for row in self.rows(p):
            height, width = frame.shape
            late = float(p["readout"][row]) * (np.arange(height, dtype=np.float32) / max(height - 1, 1) - 0.5)
            near = nearness(frame, int(row))
            shift = arriving(image_flow(frame, int(row), near) * late[:, None, None], near)
            v, u = np.mgrid[:height, :width].astype(np.float32)
            u, v = u - shift[..., 0], v - shift[..., 1]
            if frame.rgb is not None:
                frame.rgb[row] = cv2.remap(frame.rgb[row], u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            if frame.depth is not None:
                depth = cv2.remap(frame.depth[row], u, v, cv2.INTER_NEAREST, borderValue=0)
                frame.depth[row] = np.where(depth > 0, np.maximum(depth + shift[..., 2], 0), depth)
            if frame.parts is not None:
                frame.parts[row] = cv2.remap(frame.parts[row], u, v, cv2.INTER_NEAREST, borderValue=0)
