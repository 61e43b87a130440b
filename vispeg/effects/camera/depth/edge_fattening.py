"""Edge fattening: where a stereo matcher's window straddles an edge, it finds the nearer surface, or none.

With a window of `window` px at the matcher's native size, a near object grows by half a window on each side. Here a
pixel beside an edge gets the least depth within half a window of it; a share `reject` of these pixels gets no reading.
An edge is where the largest disparity within reach exceeds the pixel's own by more than `contrast` px plus twice what
it falls to the least within reach. The disparity of a plane is linear in the image, so it falls as far to one side of a
pixel as it rises to the other: no slope is an edge. Missing readings count as disparity 0, so that a pixel beside one
is no edge. If half a window is not a whole number of image pixels, it is rounded up in a share of the pixels equal to
the fraction, and down in the others. Source: Scharstein and Szeliski, A taxonomy of dense two-frame stereo algorithms,
IJCV 47, 2002, section 3.2. Range: windows of 5 to 9 px.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect
from vispeg.effects.common.disparity import PARAMS, focal_baseline
from vispeg.effects.common.field import random_words

SLOPES = np.float32(2.0)  # at an edge the disparity rises by more than this multiple of its fall


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
        fb = focal_baseline(p, rows)
        for i, row in enumerate(rows):
            depth, scale = frame.depth[row], fb[i, 0, 0]
            radius = float(p["window"][row]) / 2 * float(frame.K[row, 0, 0]) / float(p["focal"][row])
            radius = min(radius, (min(frame.shape) - 1) / 2)
            pixels, part = int(radius), radius - int(radius)
            d = np.divide(scale, depth, out=np.zeros_like(depth), where=depth > 0)
            wide = np.ones((2 * pixels + 3,) * 2, np.uint8)
            high = cv2.dilate(d, wide)
            least_rise = SLOPES * (d - cv2.erode(d, wide)) + np.float32(p["contrast"][row])  # at an edge, px
            inner = (slice(pixels + 1, -pixels - 1),) * 2  # near the image's border one side is unknown
            candidate = np.zeros(frame.shape, bool)
            candidate[inner] = (high - d > least_rise)[inner] & (depth[inner] > 0)
            at = np.flatnonzero(candidate)
            if not len(at):
                continue
            narrow = cv2.dilate(d, np.ones((2 * pixels + 1,) * 2, np.uint8)) if pixels else d
            drawn = random_words(rng[row], (2, len(at)))  # 0 to 65535
            nearest = np.where(drawn[0] < 65536 * part, high.take(at), narrow.take(at))
            lost = drawn[1] < 65536 * float(p["reject"][row])
            straddles = nearest - d.take(at) > least_rise.take(at)
            depth.put(at, np.where(straddles, np.where(lost, 0, scale / nearest), depth.take(at)))
