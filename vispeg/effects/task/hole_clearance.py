"""Hole clearance: the hole is `width` wider than nominal, measured across (diametral).

Native mechanism: `geom_pos` of the hole's walls, each moved outwards along its own normal by half of `width`, and of
the plates around them, each moved as far along both axes of the square that they form. The model is not recompiled, so
clearance can be drawn per episode or tightened while a policy learns. Cameras see the nominal hole. A hole may become
narrower than the peg; then the peg does not fit.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import named


class HoleClearance(Effect):
    """Change of the hole's diameter."""

    name = "hole_clearance"
    family = "task"
    params = {"width": Param(0.0, -0.005, 0.005, "m", start=0.001, doc="added to the hole's diameter")}
    writes = frozenset({"geom_pos"})
    stage = "geometry"
    sizes = {"width": (-2.5e-3, -1e-3, -4e-4, 4e-4, 1e-3)}
    shown_by = ("insert", "rock")
    told_from = {"fixture_compliance": "hard-press"}
    needs = "insertion"

    def targets(self, model):
        there = named(model, "fixture")
        return [] if there and model.config.hole_mesh else there  # a user's block has no ring of walls to move

    def write(self, fields, p):
        pos, model, scene = fields["geom_pos"], fields.model, fields.robot
        # prefix of the geoms' names, angle of the first one's direction (rad), length of the direction
        for name, first, length in ((scene.wall, 0.0, 1.0), (scene.plate, -np.pi / 4, 2**0.5)):
            geoms = [g for g in range(model.ngeom) if model.geom(g).name.startswith(name)]
            number = np.array([int(model.geom(g).name.removeprefix(name)) for g in geoms])
            angle = 2 * np.pi * number / (number.max(initial=0) + 1) + first
            outwards = length * np.stack([np.cos(angle), np.sin(angle), np.zeros(len(geoms))], axis=1)
            pos[:, geoms] += 0.5 * p["width"][:, :, None] * outwards
