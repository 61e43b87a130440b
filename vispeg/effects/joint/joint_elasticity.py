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
from vispeg.effects.common.gear import STEP, coasting, coupled, followed, motor_step


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
        return STEP if p["motor_inertia"] > 0 else float("inf")

    def start(self, x, p):
        # what stands for a compliance or an inertia of 0 is used for nothing
        compliance, inertia = (np.where(p[k] > 0, p[k], 1.0) for k in ("compliance", "motor_inertia"))
        wound, tau = p["compliance"] * x.tau, x.tau.copy()
        motor = {"theta": x.q + wound, "omega": x.dq.copy(), "link": x.q.copy(), "wound": wound}
        return motor | {"gear": coupled(x, compliance, p["relaxation"], inertia), "last": tau, "before": tau}

    def drive(self, state, tau, x, p):
        soft, rotor = p["compliance"] > 0, p["motor_inertia"] > 0
        motor, coast = (state["theta"], state["omega"], state["link"]), coasting(x, state["last"], state["before"])
        *motor, torque = motor_step(*motor, tau, x, coast, 0.0, state["gear"])
        state["theta"], state["omega"], state["link"] = motor
        state["before"], state["last"] = state["last"], np.where(soft & rotor, torque, tau)
        # without a rotor the link's motion does not matter: under a constant torque the spring relaxes
        rest = p["compliance"] * tau
        state["wound"] = rest + (state["wound"] - rest) * np.exp(-x.h / p["relaxation"])
        return state["last"]

    def observe(self, state, q, dq, x, p):
        soft, rotor = p["compliance"] > 0, p["motor_inertia"] > 0
        theta, omega = followed(state["theta"], state["omega"], state["link"], x, state["gear"])
        wound = np.where(rotor, theta - x.q, state["wound"])
        rate = np.where(rotor, omega - x.dq, (p["compliance"] * state["last"] - wound) / p["relaxation"])
        return np.where(soft, q + wound, q), np.where(soft, dq + rate, dq)

    def guesses(self, look):
        return [
            {"compliance": 5e-5},
            {"compliance": 5e-5, "motor_inertia": min(look.inertia, self.params["motor_inertia"].high)},
        ]
