"""Contact stiffness: a part's contacts are `scale` times as stiff as nominal, at the same damping ratio.

Native mechanism: `geom_solref` = (time constant, damping ratio); stiffness goes as 1 / (time constant x ratio)^2, so
the time constant is divided by sqrt(scale), and rest penetration goes as 1 / scale. MuJoCo keeps the time constant
above two physics steps, which bounds how stiff a contact can become. Source: MuJoCo 4.0 manual, Modeling, Solver
parameters.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import changed, touching


class ContactStiffness(Effect):
    """Stiffness of a contact at constant damping ratio."""

    name = "contact_stiffness"
    family = "contact"
    params = {"scale": Param(1.0, 0.02, 20.0, "1", start=0.5, scale="log", doc="of the nominal stiffness")}
    writes = frozenset({"geom_solref"})
    stage = "compliance"
    sizes = {"scale": (0.05, 0.2, 0.5, 3.0)}
    shown_by = ("press", "hard-press")
    told_from = {"fixture_compliance": "hard-press"}
    needs = "two forces"

    def targets(self, model):
        return touching(model)

    def write(self, fields, p):
        time_constant = fields["geom_solref"][..., 0]
        for at, scale in changed(fields, p["scale"], 1.0):
            time_constant[at] /= np.sqrt(scale)
