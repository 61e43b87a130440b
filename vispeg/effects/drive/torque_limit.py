"""Torque limit: the drive saturates, `tau = clip(tau, +-limit)`.

MuJoCo's own mechanism is `forcerange`; the same clip is applied in the drive chain here. Source: MuJoCo 4.0 manual,
actuator/general/forcerange.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class TorqueLimit(Effect):
    """Torque saturation of the drive. Null is a limit that no drive reaches."""

    name = "torque_limit"
    family = "drive"
    commanded = True
    order = 40
    smooth = False
    params = {"limit": Param(1000.0, 0.5, 1000.0, "N m", start=20.0, scale="log", doc="greatest torque of the drive")}

    def drive(self, state, tau, x, p):
        return np.clip(tau, -p["limit"], p["limit"])

    def guesses(self, look):
        """Return the greatest torques that the motion needed: a saturated drive delivers its limit and no more."""
        torques = np.append(np.quantile(np.abs(look.needed), (1.0, 0.97, 0.9)), 1.1 * np.max(np.abs(look.needed)))
        commanded = float(np.max(np.abs(look.tau)))
        return [{"limit": float(t)} for t in torques if self.params["limit"].low < t < commanded]
