"""Contact stiffness: a part's contacts are `scale` times as stiff as nominal, at the same damping ratio.

Native mechanism: `geom_solref` = (time constant, damping ratio) and the width of `geom_solimp`, over which a contact
grows harder. Stiffness goes as 1 / (time constant x ratio)^2, so the time constant is divided by sqrt(scale); the width
is divided by `scale`, or else a contact pressed beyond it would be nearly as hard as nominal. Then any load presses 1 /
scale times as deep. MuJoCo keeps the time constant above two physics steps, which bounds how stiff a contact can
become. Source: MuJoCo 4.0 manual, Modeling, Solver parameters.
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
    params = {"scale": Param(1.0, 0.005, 20.0, "1", start=0.5, scale="log", doc="of the nominal stiffness")}
    writes = frozenset({"geom_solref", "geom_solimp"})
    stage = "compliance"
    sizes = {"scale": (0.02, 0.07, 0.25, 3.0)}
    shown_by = ("press", "hard-press")
    told_from = {"fixture_compliance": "hard-press"}
    needs = "two forces"

    def targets(self, model):
        return touching(model)

    def write(self, fields, p):
        time_constant, width = fields["geom_solref"][..., 0], fields["geom_solimp"][..., 2]
        for at, scale in changed(fields, p["scale"], 1.0):
            time_constant[at] /= np.sqrt(scale)
            width[at] /= scale
