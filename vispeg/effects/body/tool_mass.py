"""Tool mass: what the wrist's force sensor carries, without the held part, weighs `mass` more than declared.

The sensor's reading contains this mass, while a `payload` sits on the arm's side of the sensor. Native mechanism:
`body_mass` and `body_inertia` of the body `tool`, both in proportion (the shape and the centre of mass stay).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import in_scene

LEAST = 0.05  # least mass over declared mass


class ToolMass(Effect):
    """Error of the gripper's mass."""

    name = "tool_mass"
    family = "body"
    searchable = False
    params = {"mass": Param(0.0, -0.5, 5.0, "kg", start=0.1, doc="added to the gripper's mass")}
    writes = frozenset({"body_mass", "body_inertia"})
    stage = "free air"
    sizes = {"mass": (-0.1, 0.1, 0.4)}
    shown_by = ("free",)
    told_from = {
        "object_mass": "free, with and without the held part",
        "wrench_bias": "free",
        "wrench_gain": "free",
    }
    needs = "tilt"

    def targets(self, model):
        return in_scene(model, "gripper")

    def write(self, fields, p):
        tool, mass = fields.model.body("tool").id, fields["body_mass"]
        share = np.maximum(1.0 + p["mass"][:, 0] / fields.model.body_mass[tool], LEAST)
        mass[:, tool] *= share
        fields["body_inertia"][:, tool] *= share[:, None]
