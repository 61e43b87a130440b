"""Joint elasticity: a spring between motor and link, with the encoder on the motor side.

`J d(omega)/dt = tau - s`, `s = (delta + relaxation d(delta)/dt) / compliance`, `delta = theta - q`. The link gets s,
the encoder reads theta. A massless motor (`motor_inertia` 0, as in the nominal arm) leaves the link's torque as it was
and shifts the reading by `compliance tau`. Source: Spong, J. Dynamic Systems, Measurement and Control 109, 1987,
eq. (6).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.gear import coasting, motor_step


class JointElasticity(Effect):
    """Elastic gear behind the encoder, with the rotor inertia at its motor side."""

    name = "joint_elasticity"
    family = "joint"
    order = 80
    grows_from = {"rotor_inertia": {"motor_inertia": "inertia"}}
    params = {
        "compliance": Param(0.0, 0.0, 2e-3, "rad/(N m)", start=1e-4, doc="wind-up per torque (1 / stiffness)"),
        "relaxation": Param(5e-3, 5e-4, 5e-2, "s", start=5e-3, shape=True, scale="log", doc="gear damping / stiffness"),
        "motor_inertia": Param(0.0, 0.0, 5.0, "kg m2", start=0.0, shape=True, doc="rotor inertia at the link side"),
    }

    def stable_step(self, p):
        # a rotor needs the link's motion in the coming step, and at 2 ms that of a light one is off by a third
        return 1e-3 if p["motor_inertia"] > 0 else float("inf")

    def start(self, x, p):
        wound, tau = p["compliance"] * x.tau, x.tau.copy()
        return {"theta": x.q + wound, "wound": wound, "omega": x.dq.copy(), "gear": tau, "before": tau}

    def drive(self, state, tau, x, p):
        soft, link = p["compliance"] > 0, coasting(x, state["before"])
        compliance, inertia = np.where(soft, p["compliance"], 1.0), p["motor_inertia"]
        theta, omega, gear = motor_step(
            state["theta"], state["omega"], tau, x, link, 0.0, compliance, p["relaxation"], inertia
        )
        state["theta"], state["omega"], state["before"] = theta, omega, state["gear"]
        state["gear"] = np.where(soft & (inertia > 0), gear, tau)
        # without a rotor the link's motion does not matter: under a constant torque the spring relaxes
        rest = p["compliance"] * tau
        state["wound"] = rest + (state["wound"] - rest) * np.exp(-x.h / p["relaxation"])
        return state["gear"]

    def observe(self, state, q, dq, x, p):
        soft, rotor = p["compliance"] > 0, p["motor_inertia"] > 0
        wound = np.where(rotor, state["theta"] - x.q, state["wound"])
        rate = np.where(rotor, state["omega"] - x.dq, (p["compliance"] * state["gear"] - wound) / p["relaxation"])
        return np.where(soft, q + wound, q), np.where(soft, dq + rate, dq)

    def guesses(self, look):
        return [
            {"compliance": 5e-5},
            {"compliance": 5e-5, "motor_inertia": min(look.inertia, self.params["motor_inertia"].high)},
        ]
