"""Load-dependent friction: the gear's dry friction grows with the torque it carries.

`level = coefficient |tau|`, tau the torque handed to the link. Own code on MuJoCo's dry-friction constraint, the level
following the load of the last physics step. Source: Duclusaud et al., "Extended friction models for the physics
simulation of servo actuators" (BAM), 2024, model M4's load term.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class LoadFriction(Effect):
    """Dry friction proportional to the transmitted torque."""

    name = "load_friction"
    family = "joint"
    params = {"coefficient": Param(0.0, 0.0, 0.5, "1", start=0.05, doc="friction torque per transmitted torque")}

    def friction(self, state, x, p):
        return p["coefficient"] * np.abs(x.tau)
