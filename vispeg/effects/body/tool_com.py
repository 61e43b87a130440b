"""Tool centre of mass: it differs from the declared one by (x, y, z) in the flange's axes.

The tool is what the wrist's force sensor carries, without the held part. Native mechanism: `body_ipos` of the body
`tool`; the inertia about the centre of mass is kept.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import in_scene


class ToolCom(Effect):
    """Error of the gripper's centre of mass."""

    name = "tool_com"
    family = "body"
    searchable = False
    params = {
        axis: Param(0.0, -0.1, 0.1, "m", start=0.01, doc=f"shift along the flange's {axis} axis") for axis in "xyz"
    }
    writes = frozenset({"body_ipos"})
    stage = "free air"
    sizes = dict.fromkeys("xyz", (-0.005, 0.005))
    shown_by = ("free",)
    told_from = {"wrench_bias": "free", "object_mass": "free"}
    needs = "tilt"

    def targets(self, model):
        return in_scene(model, "gripper")

    def write(self, fields, p):
        shift = np.stack([p[axis][:, 0] for axis in "xyz"], axis=1)
        fields["body_ipos"][:, fields.model.body("tool").id] += shift
