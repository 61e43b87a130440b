"""Motion blur: light is averaged along the line by which the image moves while the shutter is open.

The line is the sum of two shifts: `length` px in the direction `angle`, and the shift of the image's centre by the
camera's own motion (v, w) in `exposure` seconds, du/dt = -fx (vx / z + wy), dv/dt = -fy (vy / z - wx), with the scene's
mean 1 / z. Source of the flow: Longuet-Higgins and Prazdny, The interpretation of a moving retinal image, 1980, at the
principal point. Ranges: 0 to 3 px in practitioners' recipes; 2 to 20 ms of exposure indoors.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.disparity import disparity, truth
from vispeg.effects.common.light import LightEffect

LONGEST = 31.0  # px; a longer line is shortened to this: nothing could be seen in the image anyhow


class MotionBlur(LightEffect):
    """Motion blur over the exposure time."""

    name = "motion_blur"
    channel = "light"
    order = 54
    params = {
        "length": Param(0.0, 0.0, 15.0, "px", start=2.0, doc="length of the blur along `angle`"),
        "exposure": Param(0.0, 0.0, 0.1, "s", start=0.01, doc="exposure time, for the camera's own motion"),
        "angle": Param(
            0.0, -np.pi, np.pi, "rad", start=0.0, shape=True, doc="direction of `length`: 0 right, pi/2 down"
        ),
    }

    def light(self, frame, p, rng):
        import cv2

        du = np.asarray(p["length"]) * np.cos(p["angle"])
        dv = np.asarray(p["length"]) * np.sin(p["angle"])
        if frame.velocity is not None and np.any(p["exposure"]):
            flow = _flow(frame) * np.asarray(p["exposure"])[:, None]
            du, dv = du + flow[:, 0], dv + flow[:, 1]

        def smear(light, row):
            kernel = line_kernel(float(du[row]), float(dv[row]))
            return cv2.filter2D(light, -1, kernel, borderType=cv2.BORDER_REPLICATE)

        return smear


@lru_cache(maxsize=1024)  # the blur by `length` is the same for a whole episode
def line_kernel(du: float, dv: float) -> np.ndarray:
    """Return weights (2r + 1, 2r + 1) float32 of sum 1: a centred line of extent (du, dv) px, at most `LONGEST` long.

    Each point of the line is shared among the four pixels around it, which keeps the line's centre exact.
    """
    scale = min(1.0, LONGEST / max(float(np.hypot(du, dv)), 1e-9))
    du, dv = du * scale, dv * scale
    r = int(np.ceil(max(abs(du), abs(dv)) / 2)) + 1
    count = 8 * r
    t = (np.arange(count) + 0.5) / count - 0.5
    u, v = du * t + r, dv * t + r
    i, j = np.floor(v).astype(int), np.floor(u).astype(int)
    a, b = v - i, u - j
    side = 2 * r + 1
    at = i * side + j
    cells = np.concatenate([at, at + 1, at + side, at + side + 1])
    weights = np.concatenate([(1 - a) * (1 - b), (1 - a) * b, a * (1 - b), a * b]) / count
    return np.bincount(cells, weights, side * side).reshape(side, side).astype(np.float32)


def _flow(frame) -> np.ndarray:
    """Return the motion (n, 2) of the image's centre in px/s, at the mean 1 / z of the image; at 1 m without depth."""
    inverse = np.ones(frame.n)
    if (depth := truth(frame)) is not None:
        for row, z in enumerate(depth):
            inverse[row] = float(disparity(z, np.float32(1)).sum()) / max(np.count_nonzero(z), 1)
    v = frame.velocity
    fx, fy = frame.K[:, 0, 0], frame.K[:, 1, 1]
    return np.stack([-fx * (v[:, 0] * inverse + v[:, 4]), -fy * (v[:, 1] * inverse - v[:, 3])], axis=1)
