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
from vispeg.effects.common.gear import coasting, free_step, motor_step

# s, damping of the teeth in contact over their stiffness. A recording hardly tells it, so it is not fitted: half or
# double of it changes the angles of the iiwa14's joints 2 and 4 by 3 % of a gap of 0.6 mrad (RMS in 2 s).
TOOTH_RELAXATION = 2e-3
STEP = 1e-3  # s: at 2 ms a rotor inside the gap, under a stiff servo, becomes unstable
# s, limits the cost to four times that of STEP. Only inertia times compliance below 1.1e-7 s^2 asks for less, 0.12 ms
# at the corner of the bounds. There the play of the iiwa14's joints 4 and 6 is stable, and in 2 s within 1.4 gaps of
# what it is at 0.06 ms (at 1 ms: 7 gaps).
LEAST_STEP = 2.5e-4
PHASE = 0.75  # rad, greatest phase per step of the rotor's oscillation against the teeth; its period is then 2 % off


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
        """Return a step that resolves a light rotor against stiff teeth: `STEP`, halved as often as needed."""
        step, most = STEP, PHASE * (p["motor_inertia"] * p["compliance"]) ** 0.5
        while step > max(most, LEAST_STEP):
            step /= 2
        return step

    def start(self, x, p):
        side = np.where(x.tau >= 0, 0.5, -0.5)
        loose = p["gap"] > 0
        theta = x.q + side * p["gap"] + loose * p["compliance"] * x.tau
        return {"theta": theta, "omega": x.dq.copy(), "gear": x.tau.copy(), "before": x.tau.copy()}

    def drive(self, state, tau, x, p):
        loose, inertia, half = p["gap"] > 0, p["motor_inertia"], 0.5 * p["gap"]
        theta0, omega0 = state["theta"], state["omega"]
        theta, omega = free_step(theta0, omega0, tau, x, inertia)
        link = coasting(x, state["before"])
        free_delta = theta - x.q - x.h * link  # `delta` at the end of a free step
        offset = np.where(free_delta > half, half, -half)
        hit_theta, hit_omega, gear = motor_step(
            theta0, omega0, tau, x, link, offset, p["compliance"], TOOTH_RELAXATION, inertia
        )
        touching = (np.abs(free_delta) > half) & (gear * offset > 0)  # teeth push, they never pull
        state["theta"] = np.where(touching, hit_theta, theta)
        state["omega"] = np.where(touching, hit_omega, omega)
        state["before"] = state["gear"]
        state["gear"] = np.where(loose, np.where(touching, gear, 0.0), tau)
        return state["gear"]

    def observe(self, state, q, dq, x, p):
        loose = p["gap"] > 0
        return np.where(loose, q + (state["theta"] - x.q), q), np.where(loose, dq + (state["omega"] - x.dq), dq)

    def guesses(self, look):
        inertia = self.params["motor_inertia"]
        rotors = {float(np.clip(k * look.inertia, inertia.low, inertia.high)) for k in (0.25, 1.0)}
        return [{"gap": g, "motor_inertia": i} for g in (3e-4, 1.5e-3) for i in sorted(rotors)]
