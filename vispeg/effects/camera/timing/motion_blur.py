"""Motion blur: light is averaged along the line by which each pixel moves while the shutter is open.

The line is the sum of two shifts: `length` px in the direction `angle`, the same for all pixels, and the shift in
`exposure` seconds by the camera's motion relative to the body that the pixel shows
(`vispeg.effects.common.image_motion`). What is carried with the camera stays sharp, and what moves before a camera at
rest does not. Ranges: 0 to 3 px in the SVRC's guide (docs/sources.md); 2 to 20 ms of exposure
indoors.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import LOOK_FAST
from vispeg.effects.common.image_motion import arriving, image_flow, nearness
from vispeg.effects.common.light import LightEffect

LONGEST = 31.0  # px; a longer line is shortened to this: nothing could be seen in the image anyhow


class MotionBlur(LightEffect):
    """Motion blur over the exposure time."""

    name = "motion_blur"
    channel = "light"
    order = 54
    moving = ("exposure",)
    shown_by = (LOOK_FAST,)
    params = {
        "length": Param(0.0, 0.0, 15.0, "px", start=2.0, doc="length of the blur along `angle`"),
        "exposure": Param(0.0, 0.0, 0.1, "s", start=0.01, doc="exposure time, for what moves before the camera"),
        "angle": Param(
            0.0, -np.pi, np.pi, "rad", start=0.0, shape=True, doc="direction of `length`: 0 right, pi/2 down"
        ),
    }

    def light(self, frame, p, rng):
        import cv2

        du = np.asarray(p["length"]) * np.cos(p["angle"])
        dv = np.asarray(p["length"]) * np.sin(p["angle"])

        def smear(light, row):
            if frame.velocity is not None and p["exposure"][row]:
                near = nearness(frame, row)
                moved = image_flow(frame, row, near) * np.float32(p["exposure"][row])
                if moved[..., :2].any():
                    moved[..., :2] += np.array((du[row], dv[row]), np.float32)
                    return averaged(light, moved, near)
            kernel = line_kernel(float(du[row]), float(dv[row]))
            return cv2.filter2D(light, -1, kernel, borderType=cv2.BORDER_REPLICATE)

        return smear


def averaged(light: np.ndarray, moved: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Return the mean (H, W, 3) of an image's light at moments about a pixel of motion apart.

    Args:
        light: (H, W, 3), at the middle moment.
        moved: (H, W, 3) by how much what each pixel shows moves in all: px across and down, and m away.
        near: (H, W) 1/m, as by `nearness`.
    """
    import cv2

    length = np.hypot(moved[..., 0], moved[..., 1])
    moved = moved * np.minimum(1, LONGEST / np.maximum(length, 1e-9))[..., None]
    count = int(np.ceil(min(float(length.max()), LONGEST))) + 1
    height, width = near.shape
    v, u = np.mgrid[:height, :width].astype(np.float32)
    total = np.zeros_like(light)
    for t in (np.arange(count, dtype=np.float32) + 0.5) / count - 0.5:
        shift = arriving(moved * t, near)
        at = u - shift[..., 0], v - shift[..., 1]
        total += cv2.remap(light, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return total / count


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
