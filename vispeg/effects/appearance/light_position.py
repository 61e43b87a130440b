"""Light position: a lamp hangs elsewhere, and is turned so that it still points at the same spot of the table.

Native mechanism: `light_pos` and `light_dir`; the spot is where the nominal axis meets z = 0, or 1 m along the axis for
a lamp that does not point down.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.appearance import LightLook


class LightPosition(LightLook):
    """Position of a lamp that stays aimed at the same spot."""

    name = "light_position"
    order = 40
    params = {a: Param(0.0, -1.0, 1.0, "m", start=0.4, doc=f"moved along the world's {a} axis") for a in "xyz"}
    writes = frozenset({"light_pos", "light_dir"})

    def write(self, fields, p):
        for column, name in enumerate(self.targets(fields.scene)):
            shift = np.stack([p[a][:, column] for a in "xyz"], axis=1)  # (nsim, 3)
            i = fields.model.light(name).id
            for row in np.flatnonzero(shift.any(axis=1)):
                pos, axis = fields["light_pos"][row, i], fields["light_dir"][row, i]
                spot = pos - axis * (pos[2] / axis[2]) if axis[2] < -1e-3 else pos + axis
                pos += shift[row]
                pos[2] = max(pos[2], 0.3)  # above the table, whatever the shift
                axis[:] = (spot - pos) / np.linalg.norm(spot - pos)
