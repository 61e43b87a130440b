"""Hole tilt: the fixture is turned about the centre of the hole's mouth by `Rz(yaw) Ry(pitch) Rx(roll)`, base axes.

Native mechanism: `body_quat` of the body `fixture`, whose frame sits at the mouth. Source: roll, pitch and yaw about
fixed axes, Craig, Introduction to Robotics, section 2.8.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import fixture


def turned(quat: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return quaternions (n, 4) wxyz turned by `angles` (n, 3) rad: roll, pitch and yaw about the parent's axes."""
    from scipy.spatial.transform import Rotation

    if not len(quat):
        return quat
    return (Rotation.from_euler("xyz", angles) * Rotation.from_quat(quat, scalar_first=True)).as_quat(scalar_first=True)


class HoleTilt(Effect):
    """Orientation error of the fixture."""

    name = "hole_tilt"
    family = "task"
    params = {
        "roll": Param(0.0, -0.5, 0.5, "rad", start=0.02, doc="about the base's x axis"),
        "pitch": Param(0.0, -0.5, 0.5, "rad", start=0.02, doc="then about its y axis"),
        "yaw": Param(0.0, -3.1416, 3.1416, "rad", start=0.1, doc="then about its z axis"),
    }
    writes = frozenset({"body_quat"})
    stage = "geometry"
    posed = True
    sizes = dict.fromkeys(("roll", "pitch"), (-0.04, -0.012, 0.012, 0.04))
    shown_by = ("press", "insert", "rock")
    told_from = {"grip_pose": "insert-turned", "contact_friction": "slide"}
    needs = "press"

    def targets(self, model):
        return fixture(model)

    def write(self, fields, p):
        angles = np.stack([p[k][:, 0] for k in ("roll", "pitch", "yaw")], axis=1)
        quat, body = fields["body_quat"], fields.model.body(fields.robot.fixture).id
        rows = np.flatnonzero((angles != 0).any(axis=1))
        quat[rows, body] = turned(quat[rows, body], angles[rows])
