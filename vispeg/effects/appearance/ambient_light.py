"""Ambient light: `level` is added to the light from all directions (1 is full white), and a colour temperature set.

Native mechanism: `vis.headlight.ambient`, which the renderer Filament does not draw.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.appearance import SceneLook
from vispeg.effects.common.colour import tint_of_blackbody


class AmbientLight(SceneLook):
    """Level and colour temperature of the ambient light."""

    name = "ambient_light"
    params = {
        "level": Param(0.0, -0.5, 0.6, "1", start=0.15, doc="added to red, green and blue; each stays at least 0.02"),
        "kelvin": Param(6500.0, 2000.0, 12000.0, "K", start=5000.0, doc="colour temperature"),
    }
    writes = frozenset({"vis.headlight.ambient"})

    def write(self, fields, p):
        level, kelvin = p["level"][:, 0], p["kelvin"][:, 0]
        for row in np.flatnonzero((level != 0) | (kelvin != 6500.0)):
            ambient = fields["vis.headlight.ambient"][row]
            ambient[:] = np.maximum(ambient + level[row], 0.02) * tint_of_blackbody(float(kelvin[row]))
