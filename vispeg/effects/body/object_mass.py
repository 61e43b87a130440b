"""Object mass: the held part, or a free object, has `scale` times its nominal mass.

Native mechanism: `body_mass` and `body_inertia` of the body, both in proportion (the same shape, another density).
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import held


class ObjectMass(Effect):
    """Scale of a held or free object's mass and inertia."""

    name = "object_mass"
    family = "body"
    searchable = False
    params = {"scale": Param(1.0, 0.05, 10.0, "1", start=1.3, scale="log", doc="mass over nominal")}
    writes = frozenset({"body_mass", "body_inertia"})
    stage = "free air"
    sizes = {"scale": (0.4, 2.0)}
    shown_by = ("free",)
    told_from = {"tool_mass": "free", "wrench_bias": "free", "wrench_gain": "free"}
    needs = "weighing"

    def targets(self, model):
        return [*held(model), *getattr(model, "free", ())]

    def write(self, fields, p):
        for column, name in enumerate(self.targets(fields.robot)):
            body, scale = fields.model.body(name).id, p["scale"][:, column]
            fields["body_mass"][:, body] *= scale
            fields["body_inertia"][:, body] *= scale[:, None]
