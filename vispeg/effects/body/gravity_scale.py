"""Gravity scale: gravity is `scale` times nominal, in its own direction.

It stands for a controller that compensates the arm's weight with a wrong gravity. On Earth, gravity is 0.997 to 1.003
of the standard value. Native mechanism: `opt.gravity`.
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import in_scene


class GravityScale(Effect):
    """Scale of gravity."""

    name = "gravity_scale"
    family = "body"
    searchable = False
    params = {"scale": Param(1.0, 0.0, 2.0, "1", start=1.05, doc="gravity over nominal")}
    writes = frozenset({"opt.gravity"})

    def targets(self, model):
        return in_scene(model, "scene")

    def write(self, fields, p):
        fields["opt.gravity"][:] *= p["scale"]
