"""Motion blur: light averaged along the line that the image moves while the shutter is open.

The line is the sum of `length` in a drawn direction and of what the camera's own motion (v, w) in `exposure` seconds
moves the centre of the image at the scene's mean 1 / z: du/dt = -fx (vx / z + wy), dv/dt = -fy (vy / z - wx).
Source of the flow: Longuet-Higgins and Prazdny, The interpretation of a moving retinal image, 1980, at the principal
point. Ranges: 0 to 3 px in practitioners' recipes; 2 to 20 ms of exposure indoors.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.disparity import disparity, truth
from vispeg.effects.common.light import LightEffect

LONGEST = 31.0  # px; a longer line is a smear in which nothing can be seen anyhow


class MotionBlur(LightEffect):
    """Motion blur over the exposure time."""

    name = "motion_blur"
    channel = "light"
    order = 54
    params = {
        "length": Param(0.0, 0.0, 15.0, "px", start=2.0, doc="of the blur along `angle`"),
        "exposure": Param(0.0, 0.0, 0.1, "s", start=0.01, doc="exposure time, for the camera's own motion"),
        "angle": Param(
            0.0, -np.pi, np.pi, "rad", start=0.0, shape=True, doc="direction of `length`, from right to down"
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


@lru_cache(maxsize=1024)  # a drawn smear is the same for a whole episode
def line_kernel(du: float, dv: float) -> np.ndarray:
    """Weights (2r + 1, 2r + 1) float32 of sum 1: a straight line of extent (du, dv) px, centred, cut at 31 px.

    The line's points are shared among the four pixels around each, which keeps its centre exact.
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
    """Motion (n, 2) of the image's centre in px/s; without depth, at 1 m."""
    inverse = np.ones(frame.n)
    if frame.depth is not None:
        for row, z in enumerate(truth(frame)):
            inverse[row] = float(disparity(z, np.float32(1)).sum()) / max(np.count_nonzero(z), 1)
    v = frame.velocity
    fx, fy = frame.K[:, 0, 0], frame.K[:, 1, 1]
    return np.stack([-fx * (v[:, 0] * inverse + v[:, 4]), -fy * (v[:, 1] * inverse - v[:, 3])], axis=1)
