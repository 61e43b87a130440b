"""Material finish: how a part's surface shines, as offsets from the nominal material, clipped to [0, 1].

Native mechanism: `mat_specular`, `mat_shininess`, `mat_reflectance`. If the finish is not nominal, renderers that use
them also get `mat_roughness` = 1 - shininess and `mat_metallic` = `metallic`.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.appearance import PartLook

FIELDS = {"specular": "mat_specular", "shininess": "mat_shininess", "reflectance": "mat_reflectance"}


class MaterialFinish(PartLook):
    """Highlights, reflectance and metalness of a material."""

    name = "material_finish"
    params = {
        "specular": Param(0.0, -1.0, 1.0, "1", start=0.4, doc="added to the strength of highlights"),
        "shininess": Param(0.0, -1.0, 1.0, "1", start=0.3, doc="added to the sharpness of highlights"),
        "reflectance": Param(0.0, 0.0, 0.6, "1", start=0.2, doc="added to the strength of mirror images, if drawn"),
        "metallic": Param(0.0, 0.0, 1.0, "1", start=0.5, doc="share of metal, in a physically based renderer"),
    }
    writes = frozenset({*FIELDS.values(), "mat_roughness", "mat_metallic"})

    def write(self, fields, p):
        for column, part in enumerate(self.targets(fields.scene)):
            m = fields.model.material(part).id
            rows = np.flatnonzero(np.any([v[:, column] != 0 for v in p.values()], axis=0))
            if not len(rows):
                continue
            for name, field in FIELDS.items():
                fields[field][rows, m] = np.clip(fields[field][rows, m] + p[name][rows, column], 0, 1)
            fields["mat_roughness"][rows, m] = 1 - fields["mat_shininess"][rows, m]
            fields["mat_metallic"][rows, m] = p["metallic"][rows, column]
