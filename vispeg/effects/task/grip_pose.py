"""Grip pose: the held part is shifted by (x, y, z) and turned by roll and pitch between the fingers.

Axes are the flange's; it is turned about its centre of mass. Native mechanism: `body_pos` and `body_quat` of its body.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.inertia import rotation
from vispeg.effects.common.parts import held
from vispeg.effects.task.hole_tilt import turned


class GripPose(Effect):
    """Pose error of the held part in the gripper."""

    name = "grip_pose"
    family = "task"
    params = {
        **{axis: Param(0.0, -0.01, 0.01, "m", start=0.001, doc=f"shift along the flange's {axis}") for axis in "xyz"},
        "roll": Param(0.0, -0.2, 0.2, "rad", start=0.02, doc="turn about the flange's x axis"),
        "pitch": Param(0.0, -0.2, 0.2, "rad", start=0.02, doc="then about its y axis"),
    }
    writes = frozenset({"body_pos", "body_quat"})
    stage = "geometry"
    posed = True
    sizes = {
        **dict.fromkeys("xyz", (-3e-3, -1e-3, -3e-4, 3e-4, 1e-3, 3e-3)),
        **dict.fromkeys(("roll", "pitch"), (-0.04, -0.012, 0.012, 0.04)),
    }
    shown_by = ("press", "insert", "touch-datum")
    told_from = {"hole_offset": "insert-turned", "hole_tilt": "insert-turned"}
    told_by = {"z": "touch-datum"}
    needs = "turned insertions"

    def targets(self, model):
        return held(model)

    def write(self, fields, p):
        shift = np.stack([p[axis][:, 0] for axis in "xyz"], axis=1)
        angles = np.stack([p["roll"][:, 0], p["pitch"][:, 0], np.zeros(len(shift))], axis=1)
        pos, quat, body = fields["body_pos"], fields["body_quat"], fields.model.body(fields.robot.held)
        rows = np.flatnonzero((angles != 0).any(axis=1))
        before = rotation(quat[rows, body.id])
        quat[rows, body.id] = turned(quat[rows, body.id], angles[rows])
        pos[rows, body.id] += (before - rotation(quat[rows, body.id])) @ body.ipos
        pos[:, body.id] += shift
