"""Sky: random surroundings that show where no surface is: sky, horizon and ground colours, dark objects and lamps.

Native mechanism: pixels of the skybox texture `sky`.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param, seed_param
from vispeg.core.seeds import stream
from vispeg.effects.common.appearance import SceneLook, blend, pixels
from vispeg.effects.common.panorama import directions, look_up, procedural, tone_mapped


class Sky(SceneLook):
    """Procedural surroundings."""

    name = "sky"
    order = 40
    params = {
        "amount": Param(0.0, 0.0, 1.0, "1", start=1.0, doc="share of the procedural sky over the nominal one"),
        "seed": seed_param("seed of colours, objects and lamps", start=1.0),
    }
    writes = frozenset({"tex_data"})

    def write(self, fields, p):
        for row in np.flatnonzero(p["amount"][:, 0]):
            texture = pixels(fields, int(row), "sky")
            panorama = procedural(stream(int(p["seed"][row, 0]), "sky"))
            light = look_up(tone_mapped(panorama), directions(texture.shape[1]))
            texture[:] = blend(texture, light, float(p["amount"][row, 0]))
