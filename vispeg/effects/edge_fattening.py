"""Edge fattening: a matching window that straddles an edge answers with the nearer surface, or not at all.

With a window of `window` px at the matcher's size, a nearer thing grows by half of that on each side; here the least
depth within the half window replaces what lies behind it by more than `contrast` px of disparity, and a share `reject`
of such pixels has none. What of the half window is less than a pixel of the image is given to that share of the pixels.
Source: Scharstein and Szeliski, A taxonomy of dense two-frame stereo algorithms, IJCV 47, 2002, section 3.2. Range:
windows of 5 to 9 px.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects._camera import CameraEffect
from vispeg.effects._disparity import PARAMS, gauge
from vispeg.effects._field import words

FAR = np.float32(1e6)


class EdgeFattening(CameraEffect):
    """Near things grow over what is behind them."""

    name = "edge_fattening"
    order = 18
    params = {
        "window": Param(0.0, 0.0, 31.0, "px", start=7.0, doc="side of the matcher's window, at its native size"),
        "reject": Param(0.3, 0.0, 1.0, "1", start=0.3, shape=True, doc="share of straddling pixels that are lost"),
        "contrast": Param(2.0, 0.2, 50.0, "px", start=2.0, shape=True, doc="step in disparity that makes an edge"),
        **PARAMS,
    }

    def image(self, state, frame, p, rng):
        import cv2

        rows = self.rows(p)
        if frame.depth is None or not len(rows):
            return
        fb = gauge(p, rows)
        for i, row in enumerate(rows):
            depth = frame.depth[row].ravel()
            radius = float(p["window"][row]) / 2 * float(frame.K[row, 0, 0]) / float(p["focal"][row])
            radius = min(radius, min(frame.shape) / 2)
            whole, part = int(radius), radius - int(radius)
            solid = np.where(frame.depth[row] > 0, frame.depth[row], FAR)
            wide = cv2.erode(solid, np.ones((2 * whole + 3,) * 2, np.uint8)).ravel()
            contrast = np.float32(p["contrast"][row]) / fb[i, 0, 0]
            at = np.flatnonzero(depth - wide > contrast * depth * wide)  # the step in disparity, by f B z z'
            if not len(at):
                continue
            narrow = cv2.erode(solid, np.ones((2 * whole + 1,) * 2, np.uint8)).ravel()[at] if whole else depth[at]
            dice = words(rng[row], (2, len(at)))
            near = np.where(dice[0] < 65536 * part, wide[at], narrow)
            straddles = depth[at] - near > contrast * depth[at] * near
            lost = dice[1] < 65536 * float(p["reject"][row])
            depth[at] = np.where(straddles, np.where(lost, 0, near), depth[at])
            frame.depth[row] = depth.reshape(frame.shape)
