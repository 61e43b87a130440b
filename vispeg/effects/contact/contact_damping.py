"""Contact damping: a part's contacts damp `scale` times as much as nominal, at the same stiffness.

Native mechanism: `geom_solref` = (time constant, damping ratio); damping goes as 1 / time constant and stiffness as
1 / (time constant x ratio)^2, so the ratio is multiplied and the time constant divided by `scale`. Source: MuJoCo 4.0
manual, Modeling, Solver parameters.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import changed, touching


class ContactDamping(Effect):
    """Damping of a contact at constant stiffness."""

    name = "contact_damping"
    family = "contact"
    params = {"scale": Param(1.0, 0.05, 10.0, "1", start=0.5, scale="log", doc="damping over nominal")}
    writes = frozenset({"geom_solref"})
    stage = "impact"
    sizes = {"scale": (0.2, 0.5, 2.0)}
    shown_by = ("tap",)
    told_from = {"restitution": "tap", "contact_stiffness": "tap"}
    needs = "blow"

    def targets(self, model):
        return touching(model)

    def write(self, fields, p):
        time_constant, ratio = np.moveaxis(fields["geom_solref"], -1, 0)
        for at, scale in changed(fields, p["scale"], 1.0):
            time_constant[at] /= scale
            ratio[at] *= scale
