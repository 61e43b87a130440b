"""Viscous friction: `tau = -damping dq`, the part of a gear's friction that its lubricant causes.

Native mechanism: `dof_damping`, integrated implicitly. Source: Armstrong-Helouvry et al., Automatica 30(7), 1994,
eq. (2).
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class ViscousFriction(Effect):
    """Friction torque proportional to velocity."""

    name = "viscous_friction"
    family = "joint"
    common = "friction"
    params = {"damping": Param(0.0, 0.0, 50.0, "N m s/rad", start=1.0, doc="torque per joint velocity")}
    writes = frozenset({"dof_damping"})

    def write(self, fields, p):
        fields["dof_damping"][:, fields.dofs] += p["damping"]
