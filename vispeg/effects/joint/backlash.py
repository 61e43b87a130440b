"""Backlash: free play between motor and link, with the encoder on the motor side.

The gear carries a torque s only when the teeth touch: `K (delta - gap/2)` plus damping at `delta > gap/2`,
`K (delta + gap/2)` plus damping at `delta < -gap/2`, 0 inside the gap, `delta = theta - q`; inside the gap the rotor
turns on its own inertia. Source: Nordin and Gutman, Automatica 38(10), 2002, the dead-zone model, eq. (3).
MuJoCo's own mechanism is a second hinge with a tight range.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.gear import STEP, coasting, coupled, followed, free_step, motor_step

# s, damping of the teeth in contact over their stiffness. A recording hardly tells it, so it is not fitted: half or
# double of it changes the angles of the iiwa14's joints 2 and 4 by 3 % of a gap of 0.6 mrad (RMS in 2 s).
TOOTH_RELAXATION = 2e-3


class Backlash(Effect):
    """Free play between motor and link."""

    name = "backlash"
    family = "joint"
    order = 85
    smooth = False
    grows_from = {"rotor_inertia": {"motor_inertia": "inertia"}}
    params = {
        "gap": Param(0.0, 0.0, 0.1, "rad", start=1e-3, doc="total free play"),
        "motor_inertia": Param(
            0.2, 0.005, 3.0, "kg m2", start=0.2, shape=True, scale="log", doc="rotor inertia at the link side"
        ),
        "compliance": Param(
            3e-5, 5e-6, 2e-4, "rad/(N m)", start=3e-5, shape=True, scale="log", doc="compliance of the teeth in contact"
        ),
    }

    def stable_step(self, p):
        return STEP

    def start(self, x, p):
        side = np.where(x.tau >= 0, 0.5, -0.5)
        loose, tau = p["gap"] > 0, x.tau.copy()
        theta = x.q + side * p["gap"] + loose * p["compliance"] * x.tau
        motor = {"theta": theta, "omega": x.dq.copy(), "link": x.q.copy(), "touching": np.ones_like(theta, dtype=bool)}
        gear = coupled(x, p["compliance"], TOOTH_RELAXATION, p["motor_inertia"])
        return motor | {"gear": gear, "last": tau, "before": tau}

    def _motor(self, state, x):
        """Return the motor's angle and velocity, and the link's expected angle: inside the gap no link moves it."""
        return state["theta"], state["omega"], np.where(state["touching"], state["link"], x.q)

    def drive(self, state, tau, x, p):
        loose, half = p["gap"] > 0, 0.5 * p["gap"]
        theta, omega = free_step(state["theta"], state["omega"], tau, x, p["motor_inertia"])
        coast = coasting(x, state["last"], state["before"])
        link = x.q + x.h * (coast[0] + 0.5 * x.h * coast[1])
        offset = np.where(theta - link > half, half, -half)
        *held, torque = motor_step(*self._motor(state, x), tau, x, coast, offset, state["gear"])
        touching = (np.abs(theta - link) > half) & (torque * offset > 0)  # teeth push, they never pull
        for name, here, there in zip(("theta", "omega", "link"), held, (theta, omega, link), strict=True):
            state[name] = np.where(touching, here, there)
        state["touching"], state["before"] = touching, state["last"]
        state["last"] = np.where(loose, np.where(touching, torque, 0.0), tau)
        return state["last"]

    def observe(self, state, q, dq, x, p):
        loose, (theta, omega) = p["gap"] > 0, followed(*self._motor(state, x), x, state["gear"])
        return np.where(loose, q + (theta - x.q), q), np.where(loose, dq + (omega - x.dq), dq)

    def guesses(self, look):
        inertia = self.params["motor_inertia"]
        rotors = {float(np.clip(k * look.inertia, inertia.low, inertia.high)) for k in (0.25, 1.0)}
        return [{"motor_inertia": i} for i in sorted(rotors)]
