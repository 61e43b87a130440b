"""Peg grasp compliance: the peg moves between the fingers by (x, y) m/N, and tilts by (roll, pitch) rad/(N m).

Axes are the flange's; it tilts about the middle of the fingers' grip. Along its axis a peg slips instead, see
gripper_slip. Native mechanism: slides and hinges with springs under the body that the gripper holds,
`jnt_stiffness` = 1 / compliance, see `springs`. Source: grasp stiffness as a matrix in the object's frame, Cutkosky and
Kao 1989, Computing and controlling the compliance of a robotic hand, IEEE Trans. Robotics and Automation 5(2).
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.effects.common import springs
from vispeg.effects.common.parts import held

GRIP = 0.125  # m above the flange: the middle of the fingers' overlap with the peg


class PegGraspCompliance(Effect):
    """Compliance of the peg between the fingers."""

    name = "peg_grasp_compliance"
    family = "task"
    params = springs.compliances(
        {
            **{axis: f"deflection per force along the flange's {axis}" for axis in "xy"},
            **{
                turn: f"rotation per torque about the flange's {axis}" for turn, axis in (("roll", "x"), ("pitch", "y"))
            },
        }
    )
    writes = springs.WRITES
    stage = "compliance"
    sizes = {**dict.fromkeys("xy", (1e-5, 4e-5, 1.2e-4)), **dict.fromkeys(("roll", "pitch"), (5e-4, 3e-3, 1.5e-2))}
    shown_by = ("insert", "rock", "slide")
    told_from = {"fixture_compliance": "insert-turned"}
    needs = "two forces"

    def targets(self, model):
        return held(model)

    def build(self, spec, robot):
        springs.add(spec, robot.held, "peg_grasp", tuple(self.params), (0.0, 0.0, GRIP))

    def write(self, fields, p):
        springs.write(fields, "peg_grasp", p)
