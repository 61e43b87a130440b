"""Light count: the number of lamps that are on, at least one. The first in the scene's order are on.

Native mechanism: `light_active`.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.appearance import SceneLook


class LightCount(SceneLook):
    """Number of lamps."""

    name = "light_count"
    params = {"extra": Param(0.0, -3.0, 3.0, "1", start=1.0, doc="lamps beyond the nominal number, rounded")}
    writes = frozenset({"light_active"})

    def write(self, fields, p):
        ids = [fields.model.light(name).id for name in fields.scene.lights]
        extra = np.rint(p["extra"][:, 0]).astype(int)
        for row in np.flatnonzero(extra):
            active = fields["light_active"]
            count = np.clip(int(active[row, ids].sum()) + extra[row], 1, len(ids))
            active[row, ids] = np.arange(len(ids)) < count
