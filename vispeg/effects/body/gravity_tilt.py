"""Gravity tilt: the base is rolled about x and then pitched about y.

Gravity in the base frame is `(Rx(roll) Ry(pitch))' g`. Native mechanism: `opt.gravity`.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class GravityTilt(Effect):
    """Tilt of the base against gravity."""

    name = "gravity_tilt"
    family = "body"
    params = {
        "roll": Param(0.0, -0.35, 0.35, "rad", start=0.01, doc="rotation of the base about its x axis"),
        "pitch": Param(0.0, -0.35, 0.35, "rad", start=0.01, doc="then about its y axis"),
    }
    writes = frozenset({"opt.gravity"})

    def targets(self, model):
        return ["base"]

    def write(self, fields, p):
        roll, pitch = p["roll"][:, 0], p["pitch"][:, 0]
        rows = (roll != 0) | (pitch != 0)
        cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
        zero = np.zeros_like(roll)
        tilt = np.stack([cp, zero, sp, sr * sp, cr, -sr * cp, -cr * sp, sr, cr * cp], axis=1).reshape(-1, 3, 3)
        gravity = fields["opt.gravity"]
        gravity[rows] = np.einsum("nji,nj->ni", tilt[rows], gravity[rows])

    def side(self):
        return "link"
