"""Payload: an undeclared mass at the flange, a ball centred at (x, y, z) in the flange frame.

Native mechanism: mass, centre and inertia of the body that carries the flange. Source: parallel-axis theorem.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.inertia import add_ball


class Payload(Effect):
    """Unmodelled mass at the flange."""

    name = "payload"
    family = "body"
    moments = ("x", "y", "z")
    params = {
        "mass": Param(0.0, 0.0, 15.0, "kg", start=0.5, doc="added at the flange"),
        "x": Param(0.0, -0.2, 0.2, "m", start=0.0, shape=True, doc="centre of mass in the flange frame"),
        "y": Param(0.0, -0.2, 0.2, "m", start=0.0, shape=True, doc="centre of mass in the flange frame"),
        "z": Param(0.05, -0.1, 0.4, "m", start=0.05, shape=True, doc="centre of mass in the flange frame"),
        "radius": Param(0.03, 0.0, 0.2, "m", start=0.03, shape=True, doc="radius of a ball with the payload's inertia"),
    }
    writes = frozenset({"body_mass", "body_ipos", "body_inertia", "body_iquat"})

    def targets(self, model):
        return ["flange"]

    def write(self, fields, p):
        body, pos, mat = fields.flange
        offset = np.stack([p[k][:, 0] for k in "xyz"], axis=1)
        add_ball(fields, body, p["mass"][:, 0], pos + offset @ mat.T, p["radius"][:, 0])

    def side(self):
        return "link"
