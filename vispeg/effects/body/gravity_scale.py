"""Gravity scale: gravity is `scale` times nominal, in its own direction.

What an arm that compensates its weight by a wrong gravity feels; a real place on Earth has 0.997 to 1.003 of standard
gravity. Native mechanism: `opt.gravity`.
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
    params = {"scale": Param(1.0, 0.0, 2.0, "1", start=1.05, doc="of nominal gravity")}
    writes = frozenset({"opt.gravity"})

    def targets(self, model):
        return in_scene(model, "scene")

    def write(self, fields, p):
        fields["opt.gravity"][:] *= p["scale"]
