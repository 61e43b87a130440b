"""Occlusion: rectangles of one colour each hide a share of the image and have no depth, as objects near the lens do.

Places, proportions and colours follow from `seed`, so they stay the same during an episode. Range: 5 to 20 % of the
image in the SVRC's guide (docs/sources.md).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vispeg.core.params import Param, seed_param
from vispeg.core.seeds import stream
from vispeg.effects.common.camera import CameraEffect


class Occlusion(CameraEffect):
    """Rectangles that occlude the image."""

    name = "occlusion"
    order = 45
    random = True
    params = {
        "area": Param(0.0, 0.0, 0.4, "1", start=0.1, doc="share of the image; less if rectangles overlap"),
        "count": Param(2.0, 1.0, 8.0, "1", start=2.0, shape=True, doc="number of rectangles"),
        "seed": seed_param("picks places, proportions and colours"),
    }

    def image(self, state, frame, p, rng):
        for row in self.rows(p):
            forms = rectangles(float(p["area"][row]), round(float(p["count"][row])), int(p["seed"][row]), frame.shape)
            for where, colour in forms:
                if frame.rgb is not None:
                    frame.rgb[(row, *where)] = colour
                if frame.depth is not None:
                    frame.depth[(row, *where)] = 0
                if frame.parts is not None:
                    frame.parts[(row, *where)] = 0


@lru_cache(maxsize=1024)  # the same for a whole episode
def rectangles(area: float, count: int, seed: int, shape: tuple[int, int]) -> list[tuple[tuple[slice, slice], list]]:
    """Return (rows, columns) and colour of each rectangle: equal areas, sides in proportions from 1:2 to 2:1."""
    rng, out = stream(seed, "occlusion"), []
    for _ in range(count):
        aspect = np.exp(rng.uniform(-np.log(2), np.log(2)))
        wide = min(np.sqrt(area / count * aspect), 1.0)
        h, w = round(area / count / wide * shape[0]), round(wide * shape[1])
        top, left = (int(rng.uniform() * (size - side + 1)) for size, side in zip(shape, (h, w), strict=True))
        out.append(((slice(top, top + h), slice(left, left + w)), rng.uniform(size=3).tolist()))
    return out
