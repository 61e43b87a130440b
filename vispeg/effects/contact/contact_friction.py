"""Contact friction: a part's sliding friction is `scale` times nominal.

Native mechanism: `geom_friction`, its first column; torsional and rolling friction stay. Law: Coulomb,
`|f_t| <= mu f_n`, in the friction cone of the MuJoCo 4.0 manual, Computation, Contact. `vispeg.effects.common.parts`
says which of two touching parts determines the friction.
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import changed, touching


class ContactFriction(Effect):
    """Coefficient of sliding friction of a contact."""

    name = "contact_friction"
    family = "contact"
    params = {"scale": Param(1.0, 0.0, 5.0, "1", start=1.5, doc="coefficient of sliding friction over nominal")}
    writes = frozenset({"geom_friction"})
    stage = "friction"
    sizes = {"scale": (0.4, 0.7, 1.5, 2.2)}
    shown_by = ("slide", "insert")
    told_from = {"grip_pose": "slide"}
    needs = "two directions"

    def targets(self, model):
        return touching(model)

    def write(self, fields, p):
        sliding = fields["geom_friction"][..., 0]
        for at, scale in changed(fields, p["scale"], 1.0):
            sliding[at] *= scale
