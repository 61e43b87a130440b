"""Arm compliance: links and gears deflect under load, which the encoders do not see.

The encoder's error is `compliance` times the change of the joint's torque since the motion began. The deflection at the
beginning does not count: calibrated kinematics, or a goal taught with the same arm, contain that of the arm's own
weight. It is quasi-static; `joint_elasticity` is the spring between motor and link with its dynamics. At the flange it
is the compliance `J C J'` of Salisbury 1980, Active stiffness control of a manipulator in Cartesian coordinates, 19th
IEEE Conference on Decision and Control. It changes with the posture, which distinguishes it from a fixture's.
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import in_scene

# s, time constant of the deflection: damping over stiffness of a gear, as `joint_elasticity` has it by default. Without
# one, the loop through encoders and controller multiplies an error by -compliance * kp in each control period of h s,
# and runs away above 1. With it the limit is 1 + 2 RELAXATION / h, which is 6 at 2 ms: a kp of 6000 N m/rad at the
# greatest compliance.
RELAXATION = 5e-3


class ArmCompliance(Effect):
    """Quasi-static compliance of the joints under load, behind the encoders."""

    name = "arm_compliance"
    family = "joint"
    order = 85
    searchable = False  # in free air, the calibration contains the deflection
    shared = True
    params = {"compliance": Param(0.0, 0.0, 1e-3, "rad/(N m)", start=5e-5, doc="deflection of each joint per torque")}
    stage = "compliance"
    sizes = {"compliance": (2e-5, 1e-4)}
    shown_by = ("press", "press-elbow", "hard-press")
    told_from = {"fixture_compliance": "touch-datum", "contact_stiffness": "touch-datum"}

    def targets(self, model):
        return in_scene(model, *model.joints)

    def start(self, x, p):
        return {"rest": x.tau.copy(), "load": x.tau.copy()}

    def drive(self, state, tau, x, p):
        state["load"] += (tau - state["load"]) * (x.h / (x.h + RELAXATION))
        return tau

    def observe(self, state, q, dq, x, p):
        return q + self.yields(state["load"] - state["rest"], p), dq

    def yields(self, load, p):
        return p["compliance"] * load
