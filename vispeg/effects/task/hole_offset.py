"""Hole offset: the fixture, and the hole in it, is shifted by (x, y, z) from its nominal place, base axes.

The believed goal moves with the true one; an error of the belief alone is `goal_imprecision`. Native mechanism:
`body_pos` of the body `fixture`.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import fixture


class HoleOffset(Effect):
    """Position error of the fixture."""

    name = "hole_offset"
    family = "task"
    params = {
        axis: Param(0.0, -0.15, 0.15, "m", start=0.02, doc=f"shift along the base's {axis} axis") for axis in "xyz"
    }
    writes = frozenset({"body_pos"})
    stage = "geometry"
    posed = True
    sizes = dict.fromkeys("xyz", (-3e-3, -1e-3, -3e-4, 3e-4, 1e-3, 3e-3))
    shown_by = ("press", "insert", "rock")
    told_from = {"grip_pose": "insert-turned"}
    told_by = {"z": "touch-datum"}
    needs = "insertion"

    def targets(self, model):
        return fixture(model)

    def write(self, fields, p):
        body = fields.model.body(fields.robot.fixture).id
        fields["body_pos"][:, body] += np.stack([p[axis][:, 0] for axis in "xyz"], axis=1)
