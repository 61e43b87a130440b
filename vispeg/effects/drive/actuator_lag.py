"""Actuator lag: the torque follows its command as a first-order low-pass, `T dtau/dt = tau_cmd - tau`.

MuJoCo's own mechanism is `dyntype="filterexact"`, which applies the lagged torque of a step's beginning (or end) for
the whole step. The same exact update, `1 - exp(-h/T)`, is used here, but the mean torque over the step is applied.
Source: MuJoCo 4.0 manual, actuator dynamics "filterexact".
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class ActuatorLag(Effect):
    """First-order lag of the torque loop (finite bandwidth)."""

    name = "actuator_lag"
    family = "drive"
    commanded = True
    order = 15
    shared = True
    params = {"time_constant": Param(0.0, 0.0, 0.05, "s", start=0.004, doc="time constant of the torque loop")}

    def start(self, x, p):
        return {"act": np.full_like(x.q, np.nan)}  # at the first command, the drive has settled at it

    def drive(self, state, tau, x, p):
        before, t = np.where(np.isnan(state["act"]), tau, state["act"]), np.maximum(p["time_constant"], 1e-12)
        decay = np.exp(-x.h / t)
        state["act"] = tau + (before - tau) * decay
        # the physics step gets the mean torque over the step, which is exact for a held command
        mean = tau + (before - tau) * t / x.h * (1.0 - decay)
        return np.where(p["time_constant"] > 0, mean, tau)

    def regressor(self, look, p):
        return p["time_constant"] * look.rate(look.sent)  # sent = tau + T dtau/dt
