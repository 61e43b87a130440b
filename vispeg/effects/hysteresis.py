"""Elasto-plastic hysteresis: a spring that yields, the presliding of gear teeth and cable sheaths.

One Maxwell-slip element: `tau = -clip(stiffness (q - z), +-torque)`, the anchor z dragged along once the element slips.
The spring is taken at the predicted end of the step, so that it stays stable on a light link. MuJoCo's own mechanism is a
fixed tendon with `springyield`, which needs a compiled model for each candidate. Source: Al-Bender, Lampaert and Swevers,
IEEE Trans. Automatic Control 50(11), 2005, eq. (3), one element.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class Hysteresis(Effect):
    """A spring in parallel with the joint that yields at a torque."""

    name = "hysteresis"
    kind = "joint"
    params = {
        "torque": Param(0.0, 0.0, 30.0, "N m", start=0.5, doc="torque at which the element slips"),
        "stiffness": Param(200.0, 5.0, 3000.0, "N m/rad", start=200.0, shape=True, scale="log", doc="before it slips"),
    }
    smooth = False
    contains = ("coulomb_friction",)

    def start(self, x, p):
        return {"anchor": x.q.copy()}

    def torque(self, state, x, p):
        k, limit = p["stiffness"], p["torque"]
        compliant = 1.0 + k * x.h**2 / x.inertia  # d tau / d tau through the link's own response
        stretch = x.q + x.h * (x.dq + 0.5 * x.h * x.ddq) - state["anchor"]
        tau = np.clip(k * stretch / compliant, -limit, limit)
        reach = limit / k
        state["anchor"] = np.clip(state["anchor"], x.q - reach, x.q + reach)
        return -tau

    def guesses(self, look):
        return [{"stiffness": 50.0}, {"stiffness": 500.0}]
