"""Rotor inertia: the motor's own inertia, reflected through the gear: `tau = -inertia ddq`.

Native mechanism: `dof_armature`. Source: Spong, Hutchinson and Vidyasagar, Robot Modeling and Control, eq. (6.16),
reflected inertia = (gear ratio)^2 x rotor inertia.
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class RotorInertia(Effect):
    """Rotor inertia, in the motor's torque but not in a joint torque sensor's."""

    name = "rotor_inertia"
    family = "joint"
    common = "inertia"
    params = {"inertia": Param(0.0, 0.0, 5.0, "kg m2", start=0.1, doc="reflected to the link side")}
    writes = frozenset({"dof_armature"})

    def write(self, fields, p):
        fields["dof_armature"][:, fields.dofs] += p["inertia"]
