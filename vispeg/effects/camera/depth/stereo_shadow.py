"""Stereo shadow: surfaces that the first camera of a stereo pair sees and the second does not have no depth.

Column u of the first image lies at u - d in the second, with disparity d = f B / z in px. It is hidden there if a pixel
to its right lands further left (min over u' > u of (u' - d') < u - d), which violates the ordering constraint. So a
band f B (1 / z_near - 1 / z_far) px wide has no depth to the *left* of a nearer object, if the second camera is on the
right. With `band`, pixels outside the second image (u - d < 0) have none either. f is that of the rendered image, since
the shadow is pure geometry. Source: Marr and Poggio, Cooperative computation of stereo disparity, 1976; RealSense
datasheet 337029, "invalid depth band". Range: B of 18 to 75 mm.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.disparity import disparity, truth

SLACK = 0.05  # px, so that rounding does not hide a surface seen nearly edge-on


class StereoShadow(CameraEffect):
    """Missing depth where only one of two stereo cameras sees."""

    name = "stereo_shadow"
    order = 10
    params = {
        "baseline": Param(
            0.0, -0.3, 0.3, "m", start=0.05, doc="from the depth image's camera to the other, right positive"
        ),
        "band": Param(0.0, 0.0, 1.0, "1", start=0.0, shape=True, doc="1: no depth outside the second camera's image"),
    }

    def image(self, state, frame, p, rng):
        rows = self.rows(p)
        if frame.depth is None or not len(rows):
            return
        fb = (frame.K[:, 0, 0] * np.asarray(p["baseline"]))[rows, None, None].astype(np.float32)
        hidden = np.zeros((len(rows), *frame.shape), bool)
        d = disparity(truth(frame)[rows], np.abs(fb))
        u = np.arange(frame.shape[1], dtype=np.float32)
        for i, row in enumerate(rows):
            right = fb[i] > 0
            shift = d[i] if right else d[i][:, ::-1]  # mirrored, the second camera is on the right
            lost = _hidden(u - shift)
            if p["band"][row] > 0.5:
                lost |= u - shift < -0.5
            hidden[i] = lost if right else lost[:, ::-1]
        frame.depth[rows] = np.where(hidden, 0, frame.depth[rows])


def _hidden(at: np.ndarray) -> np.ndarray:
    """Return (H, W) bool: whether a pixel to the right lands further left in the second image, columns `at` (H, W)."""
    columns = np.ascontiguousarray(at.T[::-1])  # from the right; NumPy is ten times as fast along the first axis
    least = np.minimum.accumulate(columns, axis=0)[::-1].T
    out = np.zeros(at.shape, bool)
    out[:, :-1] = least[:, 1:] < at[:, :-1] - np.float32(SLACK)
    return out
