"""Shadows: the first `lights` lamps cast shadows; each costs one more pass of the renderer.

Native mechanism: `light_castshadow`, where the renderer was made with shadows.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.appearance import SceneLook


class Shadows(SceneLook):
    """Number of lamps that cast shadows."""

    name = "shadows"
    params = {"lights": Param(0.0, 0.0, 4.0, "1", start=1.0, doc="lamps that cast shadows, rounded")}
    writes = frozenset({"light_castshadow"})

    def write(self, fields, p):
        ids = [fields.model.light(name).id for name in fields.scene.lights]
        count = np.rint(p["lights"][:, 0]).astype(int)
        for row in np.flatnonzero(count):
            fields["light_castshadow"][row, ids[: count[row]]] = True
