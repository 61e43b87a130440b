"""Joint bias: a constant torque added to the commanded one (current offset, torque-sensor zero, residual spring).

MuJoCo's own mechanism is `qfrc_applied` or a biased actuator; it is added in the drive here. Source: FloBaRoID's torque
offsets (Bethge et al., 2016).
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class JointBias(Effect):
    """Constant torque added to the command."""

    name = "joint_bias"
    family = "drive"
    commanded = True
    common = "bias"
    order = 45
    params = {"torque": Param(0.0, -20.0, 20.0, "N m", start=0.5, doc="added to the commanded torque")}

    def drive(self, state, tau, x, p):
        return tau + p["torque"]

    def inverse(self, needed, sensor, p):
        if sensor == "joint":  # it does not see the drive's bias: what `torque` stands for here is its own wrong zero
            return needed + p["torque"]
        return needed - p["torque"]  # the reading is that of the command, to which the drive adds the bias
