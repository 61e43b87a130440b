"""Stereo shadow: what the first eye sees and the second does not has no depth.

A pixel u of the first eye lies at u - d in the second, d = f B / z in px. It is hidden there if some pixel to its right
lands further left, min over u' > u of (u' - d') < u - d, which is the ordering constraint broken. So a band
f B (1 / z_near - 1 / z_far) px wide is lost to the *left* of a nearer thing, when the second eye is on the right.
With `band`, so is what the second eye's image does not reach, u - d < 0. Here f is that of the image itself: the shadow
is geometry. Source: Marr and Poggio, Cooperative computation of stereo disparity, 1976; RealSense datasheet 337029,
"invalid depth band". Range: B of 18 to 75 mm.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.disparity import disparity, truth

SLACK = 0.05  # px; a surface seen nearly edge-on is not hidden by rounding


class StereoShadow(CameraEffect):
    """Missing depth where only one of two stereo cameras sees."""

    name = "stereo_shadow"
    order = 10
    params = {
        "baseline": Param(
            0.0, -0.3, 0.3, "m", start=0.05, doc="from the depth image's camera to the other, right positive"
        ),
        "band": Param(
            0.0, 0.0, 1.0, "1", start=0.0, shape=True, doc="1: no depth at the edge that one camera alone sees"
        ),
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
            shift = d[i] if right else d[i][:, ::-1]  # a mirrored image has its second eye on the right
            lost = _hidden(u - shift)
            if p["band"][row] > 0.5:
                lost |= u - shift < -0.5
            hidden[i] = lost if right else lost[:, ::-1]
        frame.depth[rows] = np.where(hidden, 0, frame.depth[rows])


def _hidden(at: np.ndarray) -> np.ndarray:
    """Which pixels (H, W) have one to their right that lands left of them in the second image, at `at` px."""
    columns = np.ascontiguousarray(at.T[::-1])  # from the right; along the first axis NumPy runs ten times as fast
    least = np.minimum.accumulate(columns, axis=0)[::-1].T
    out = np.zeros(at.shape, bool)
    out[:, :-1] = least[:, 1:] < at[:, :-1] - np.float32(SLACK)
    return out
