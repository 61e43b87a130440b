"""Torque-speed limit: at a fixed supply voltage a motor's greatest torque falls with its speed, down to none.

`tau <= stall (1 - dq / no_load)` in the direction of motion, `stall` against it (the drive's current limit). Null is a
stall torque that no drive reaches. MuJoCo's own mechanism is the `dcmotor` actuator, compiled into the model. Source:
Krishnan, Electric Motor Drives, 2001, eq. (2.9), the torque-speed line of a DC motor at constant armature voltage.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class TorqueSpeedLimit(Effect):
    """Supply voltage limit: available torque falls with speed."""

    name = "torque_speed_limit"
    family = "drive"
    order = 42
    smooth = False
    params = {
        "stall": Param(1000.0, 0.05, 1000.0, "N m", start=20.0, scale="log", doc="greatest torque at rest"),
        "no_load": Param(5.0, 0.3, 50.0, "rad/s", start=5.0, shape=True, scale="log", doc="no-load speed"),
    }

    def drive(self, state, tau, x, p):
        speed = (x.dq + 0.5 * x.h * x.ddq) / p["no_load"]  # in the middle of the step, over which a torque is held
        forward = p["stall"] * np.clip(1.0 - speed, 0.0, 1.0)
        backward = p["stall"] * np.clip(1.0 + speed, 0.0, 1.0)
        return np.where(p["stall"] < self.params["stall"].null, np.clip(tau, -backward, forward), tau)

    def guesses(self, look):
        """Return the greatest torques that the motion needed, with 1.1 and 2 times the speed that it reached."""
        torques, speed = np.quantile(np.abs(look.needed), (0.97, 1.0)), float(np.quantile(np.abs(look.dq), 0.999))
        stall, no_load = self.params["stall"], self.params["no_load"]
        speeds = {float(np.clip(s * speed, no_load.low, no_load.high)) for s in (1.1, 2.0)}
        stalls = [float(np.clip(t, stall.low, 0.99 * stall.null)) for t in torques]
        return [{"stall": t, "no_load": s} for t in stalls for s in sorted(speeds)]
