"""Contact damping: a part's contacts damp `scale` times as much as nominal, at the same stiffness.

Native mechanism: `geom_solref` in either of its forms, see `vispeg.effects.common.solref`. Of (time constant, damping
ratio) the ratio is multiplied and the time constant divided by `scale`. Source: MuJoCo 4.0 manual, Modeling, Solver
parameters.
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import changed, touching
from vispeg.effects.common.solref import times


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
        solref = fields["geom_solref"]
        for at, scale in changed(fields, p["scale"], 1.0):
            solref[at] = times(solref[at], damping=scale)
