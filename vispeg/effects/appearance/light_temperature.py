"""Light temperature: a lamp glows like a black body of `kelvin`; 6500 K is white.

Native mechanism: `light_diffuse` and `light_specular`, multiplied by `tint_of_blackbody`.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.appearance import LightLook
from vispeg.effects.common.colour import tint_of_blackbody


class LightTemperature(LightLook):
    """Colour temperature of a lamp."""

    name = "light_temperature"
    params = {"kelvin": Param(6500.0, 2000.0, 12000.0, "K", start=4000.0, doc="colour temperature")}
    writes = frozenset({"light_diffuse", "light_specular"})

    def write(self, fields, p):
        for column, name in enumerate(self.targets(fields.scene)):
            i = fields.model.light(name).id
            for row in np.flatnonzero(p["kelvin"][:, column] != 6500.0):
                tint = tint_of_blackbody(float(p["kelvin"][row, column]))
                for field in self.writes:
                    fields[field][row, i] *= tint
