"""Coulomb friction: `tau = -torque sign(dq)` in motion; at rest it holds the joint with up to `torque`.

Native mechanism: `dof_frictionloss`, a constraint solved implicitly, made stiff so that a joint stops within one step.
Source: Armstrong-Helouvry et al., Automatica 30(7), 1994, eq. (1).
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class CoulombFriction(Effect):
    """Constant friction torque against the direction of motion."""

    name = "coulomb_friction"
    family = "joint"
    common = "friction"
    params = {"torque": Param(0.0, 0.0, 30.0, "N m", start=0.5, doc="friction torque in motion and at rest")}
    writes = frozenset({"dof_frictionloss"})

    def write(self, fields, p):
        fields["dof_frictionloss"][:, fields.dofs] += p["torque"]
