"""Light intensity: a lamp is `gain` times as bright as nominal.

Native mechanism: `light_diffuse` and `light_specular`.
"""

from __future__ import annotations

from vispeg.core.params import Param
from vispeg.effects.common.appearance import LightLook


class LightIntensity(LightLook):
    """Brightness of a lamp."""

    name = "light_intensity"
    params = {"gain": Param(1.0, 0.05, 4.0, "1", start=1.5, scale="log", doc="brightness over nominal")}
    writes = frozenset({"light_diffuse", "light_specular"})

    def write(self, fields, p):
        ids = [fields.model.light(name).id for name in self.targets(fields.scene)]
        for field in self.writes:
            fields[field][:, ids] *= p["gain"][:, :, None]
