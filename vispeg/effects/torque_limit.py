"""Torque limit: the drive saturates, `tau = clip(tau, +-limit)`.

MuJoCo's own mechanism is `forcerange`; the same clip is applied in the drive chain here. Source: MuJoCo 4.0 manual,
actuator/general/forcerange.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class TorqueLimit(Effect):
    """Saturation of the drive's torque. Null is a limit no drive reaches."""

    name = "torque_limit"
    kind = "drive"
    order = 40
    smooth = False
    params = {"limit": Param(1000.0, 0.5, 1000.0, "N m", start=20.0, scale="log", doc="greatest torque of the drive")}

    def drive(self, state, tau, x, p):
        return np.clip(tau, -p["limit"], p["limit"])

    def guesses(self, look):
        """Just under the greatest torques that were asked for; nothing lower was ever reached."""
        top = float(np.max(np.abs(look.tau)))
        fractions = (0.9, 0.7, 0.5)
        return [{"limit": f * top} for f in fractions if self.params["limit"].low < f * top < self.params["limit"].high]
