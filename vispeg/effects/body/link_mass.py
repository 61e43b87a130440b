"""Link mass: a link is heavier or lighter than its data sheet says, its shape unchanged.

The centre of mass stays, and the inertia scales with the mass. Native mechanism: `body_mass`, `body_inertia`.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param

LEAST = 0.05  # least mass over nominal mass: a link cannot weigh nothing


class LinkMass(Effect):
    """Error of a link's mass."""

    name = "link_mass"
    family = "body"
    likelier = ("payload",)
    params = {"mass": Param(0.0, -3.0, 6.0, "kg", start=0.3, doc="added to the nominal mass")}
    writes = frozenset({"body_mass", "body_inertia"})

    def targets(self, model):
        return list(model.links)

    def limits(self, model, where):
        return {"mass": ((LEAST - 1.0) * float(model.body(where).mass[0]), self.params["mass"].high)}

    def write(self, fields, p):
        for column, body in enumerate(fields.links):
            delta = p["mass"][:, column]
            rows = delta != 0
            if rows.any():
                scale = np.maximum(1.0 + delta[rows] / fields["body_mass"][rows, body], LEAST)
                fields["body_mass"][rows, body] *= scale
                fields["body_inertia"][rows, body] *= scale[:, None]

    def side(self):
        return "link"
