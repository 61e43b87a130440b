"""Edge fattening: a matching window that straddles an edge answers with the nearer surface, or not at all.

With a window of `window` px at the matcher's size, a nearer thing grows by half of that on each side; here the least
depth within the half window replaces what lies behind it by more than `contrast` px of disparity beyond what the slope
of the surface explains, and a share `reject` of such pixels has none. A plane's disparity is linear in the image, so it
falls as far to one side of a pixel as it rises to the other; at an edge it rises further. What
of the half window is less than a pixel of the image is given to that share of the pixels. Source: Scharstein and
Szeliski, A taxonomy of dense two-frame stereo algorithms, IJCV 47, 2002, section 3.2. Range: windows of 5 to 9 px.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.disparity import PARAMS, gauge
from vispeg.effects.common.field import words

SLOPES = np.float32(2.0)  # an edge rises so many times as far to its near side as it falls to the other


class EdgeFattening(CameraEffect):
    """Edges of near surfaces shifted over the background by a stereo matcher's window."""

    name = "edge_fattening"
    channel = "depth"
    order = 18
    params = {
        "window": Param(0.0, 0.0, 31.0, "px", start=7.0, doc="side of the matcher's window, at its native size"),
        "reject": Param(0.3, 0.0, 1.0, "1", start=0.3, shape=True, doc="share of edge pixels without a reading"),
        "contrast": Param(2.0, 0.2, 50.0, "px", start=2.0, shape=True, doc="disparity step that counts as an edge"),
        **PARAMS,
    }

    def image(self, state, frame, p, rng):
        import cv2

        rows = self.rows(p)
        if frame.depth is None or not len(rows):
            return
        fb = gauge(p, rows)
        for i, row in enumerate(rows):
            depth, scale = frame.depth[row], fb[i, 0, 0]
            radius = float(p["window"][row]) / 2 * float(frame.K[row, 0, 0]) / float(p["focal"][row])
            radius = min(radius, (min(frame.shape) - 1) / 2)
            pixels, part = int(radius), radius - int(radius)
            d = np.divide(scale, depth, out=np.zeros_like(depth), where=depth > 0)
            wide = np.ones((2 * pixels + 3,) * 2, np.uint8)
            high = cv2.dilate(d, wide)
            edge = SLOPES * (d - cv2.erode(d, wide)) + np.float32(p["contrast"][row])
            inner = (slice(pixels + 1, -pixels - 1),) * 2  # at the border, one side is not known
            candidate = np.zeros(frame.shape, bool)
            candidate[inner] = (high - d > edge)[inner] & (depth[inner] > 0)
            at = np.flatnonzero(candidate)
            if not len(at):
                continue
            narrow = cv2.dilate(d, np.ones((2 * pixels + 1,) * 2, np.uint8)) if pixels else d
            dice = words(rng[row], (2, len(at)))
            taken = np.where(dice[0] < 65536 * part, high.take(at), narrow.take(at))
            lost = dice[1] < 65536 * float(p["reject"][row])
            straddles = taken - d.take(at) > edge.take(at)
            depth.put(at, np.where(straddles, np.where(lost, 0, scale / taken), depth.take(at)))
