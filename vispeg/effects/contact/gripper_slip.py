"""Gripper slip: the held part slips along its axis at `grip` times the nominal force.

While it slips, `viscosity` times its speed adds to the force, as with soft finger pads. Native mechanism:
`dof_frictionloss`, dry friction in N, and `dof_damping`, N s/m, of the slide between part and gripper. Sources:
Coulomb's law for two fingers, `2 mu F`, of which `grip` scales the product; rubber friction grows with the sliding
speed, Persson 2001, Theory of rubber friction and contact mechanics, J. Chem. Phys. 115.
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import held


class GripperSlip(Effect):
    """Force at which the held part slips in the gripper."""

    name = "gripper_slip"
    family = "contact"
    params = {
        "grip": Param(1.0, 0.0, 2.0, "1", start=0.3, doc="force at which the part slips, over nominal"),
        "viscosity": Param(0.0, 0.0, 1e4, "N s/m", start=1e3, doc="additional force per sliding speed"),
    }
    writes = frozenset({"dof_frictionloss", "dof_damping"})
    stage = "friction"
    sizes = {"grip": (0.07, 0.15, 0.3, 0.6)}
    beside = ("viscosity",)
    remembers = True
    shown_by = ("hard-press",)
    told_from = {"grip_pose": "hard-press"}
    needs = "hard press"

    def targets(self, model):
        return held(model) if getattr(model, "slip", "") else []

    def write(self, fields, p):
        slide = fields.model.joint(fields.robot.slip).dofadr[0]
        fields["dof_frictionloss"][:, slide] *= p["grip"][:, 0]
        fields["dof_damping"][:, slide] += p["viscosity"][:, 0]
