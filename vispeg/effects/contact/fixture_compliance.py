"""Fixture compliance: the fixture moves under load by (x, y, z) m/N, and tilts by (roll, pitch) rad/(N m).

Axes are those of the base. It tilts about the origin of its frame, the goal; without load it has its nominal pose.
Native mechanism: slides and hinges with springs under the fixture's body, `jnt_stiffness` = 1 / compliance, see
`springs`. Source: a remote centre of compliance as diagonal stiffness, Whitney 1982, Quasi-static assembly of
compliantly supported rigid parts, J. Dyn. Sys. Meas. Control 104.
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.effects.common import springs
from vispeg.effects.common.parts import fixture

MASS, INERTIA = 0.5, (1e-3, 1e-3, 1e-3)  # kg, kg m^2 of the fixture, in addition to those of the springs


class FixtureCompliance(Effect):
    """Compliance of the fixture's mount."""

    name = "fixture_compliance"
    family = "contact"
    params = springs.compliances(
        {
            **{axis: f"deflection per force along the base's {axis}" for axis in "xyz"},
            **{turn: f"rotation per torque about the base's {axis}" for turn, axis in (("roll", "x"), ("pitch", "y"))},
        }
    )
    writes = springs.WRITES
    stage = "compliance"
    sizes = {**dict.fromkeys("xyz", (1e-5, 4e-5, 1.2e-4)), **dict.fromkeys(("roll", "pitch"), (2e-4, 1e-3, 5e-3))}
    shown_by = ("press", "hard-press", "rock")
    told_from = {"contact_stiffness": "hard-press", "arm_compliance": "touch-datum"}
    needs = "two forces"

    def targets(self, model):
        return fixture(model)

    def build(self, spec, robot):
        body = spec.body(robot.fixture)
        body.gravcomp, body.explicitinertial = 1.0, True
        body.mass, body.inertia, body.ipos = MASS, INERTIA, (0.0, 0.0, -0.02)
        springs.add(spec, robot.fixture, "fixture", tuple(self.params), (0.0, 0.0, 0.0))

    def write(self, fields, p):
        springs.write(fields, "fixture", p)
