"""Light direction: a lamp's axis leans by a rotation vector (x, y) about the world's axes.

Native mechanism: `light_dir`, turned by Rodrigues' formula.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.appearance import LightLook


class LightDirection(LightLook):
    """Direction of a lamp."""

    name = "light_direction"
    order = 50
    params = {a: Param(0.0, -0.6, 0.6, "rad", start=0.2, doc=f"turned about the world's {a} axis") for a in "xy"}
    writes = frozenset({"light_dir"})

    def write(self, fields, p):
        for column, name in enumerate(self.targets(fields.scene)):
            turn = np.stack([p["x"][:, column], p["y"][:, column], np.zeros(len(p["x"]))], axis=1)
            i = fields.model.light(name).id
            for row in np.flatnonzero(turn.any(axis=1)):
                angle = np.linalg.norm(turn[row])
                k, v = turn[row] / angle, fields["light_dir"][row, i]
                v[:] = v * np.cos(angle) + np.cross(k, v) * np.sin(angle) + k * (k @ v) * (1 - np.cos(angle))
