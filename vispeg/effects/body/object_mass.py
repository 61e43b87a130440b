"""Object mass: the peg weighs `scale` times nominal, its shape unchanged.

Native mechanism: `body_mass` and `body_inertia` of the body `peg`, both in proportion (uniform density).
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import in_scene


class ObjectMass(Effect):
    """A heavier or lighter peg."""

    name = "object_mass"
    family = "body"
    searchable = False
    params = {"scale": Param(1.0, 0.05, 10.0, "1", start=1.3, scale="log", doc="of the nominal mass")}
    writes = frozenset({"body_mass", "body_inertia"})

    def targets(self, model):
        return in_scene(model, "peg")

    def write(self, fields, p):
        peg = fields.model.body("peg").id
        fields["body_mass"][:, peg] *= p["scale"][:, 0]
        fields["body_inertia"][:, peg] *= p["scale"]
