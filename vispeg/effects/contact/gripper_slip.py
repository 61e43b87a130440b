"""Gripper slip: the fingers hold their part with `grip` times the nominal force along its axis before it slips.

Native mechanism: `dof_frictionloss` of the slide between part and gripper, dry friction in N. Source: Coulomb's law for
two fingers, `2 mu F`, whose product is what `grip` scales.
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import held


class GripperSlip(Effect):
    """Force at which the held part slips in the gripper."""

    name = "gripper_slip"
    family = "contact"
    params = {"grip": Param(1.0, 0.0, 2.0, "1", start=0.3, doc="of the nominal force at which it slips")}
    writes = frozenset({"dof_frictionloss"})
    stage = "friction"
    sizes = {"grip": (0.07, 0.15, 0.3, 0.6)}
    shown_by = ("hard-press",)
    told_from = {"grip_pose": "hard-press"}
    needs = "hard press"

    def targets(self, model):
        return held(model) if getattr(model, "slip", "") else []

    def write(self, fields, p):
        fields["dof_frictionloss"][:, fields.model.joint(fields.robot.slip).dofadr[0]] *= p["grip"][:, 0]
