"""Cogging and gear ripple: a torque periodic in the joint angle, `tau = amplitude sin(poles q + phase)`.

MuJoCo's own mechanism is a passive `dcmotor` with `cogging`, which needs a compiled model for each candidate; the same
equation is applied as a joint torque here. Source: MuJoCo 4.0 manual, actuator/dcmotor/cogging.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class Cogging(Effect):
    """Periodic torque ripple over the joint angle."""

    name = "cogging"
    family = "joint"
    smooth = False
    conservative = True
    params = {
        "amplitude": Param(0.0, 0.0, 10.0, "N m", start=0.3, doc="amplitude of the ripple"),
        "poles": Param(
            12.0, 2.0, 200.0, "1/rev", start=12.0, shape=True, scale="log", doc="periods per turn of the joint"
        ),
        "phase": Param(0.0, -np.pi, np.pi, "rad", start=0.0, shape=True, doc="phase at joint angle 0"),
    }

    def torque(self, state, x, p):
        return p["amplitude"] * np.sin(p["poles"] * x.q + p["phase"])

    def guesses(self, look):
        """Return poles and phase of the two strongest ripples of the missing torque (least-squares periodogram)."""
        poles = np.geomspace(self.params["poles"].low, self.params["poles"].high, 120)
        span = float(np.ptp(look.q))
        poles = poles[poles * span > np.pi]  # a ripple shows only over half a period or more
        excess = look.excess - look.excess.mean()
        if not len(poles):
            return [{}]
        best = []
        for n in poles:
            basis = np.stack([np.sin(n * look.q), np.cos(n * look.q), np.ones_like(look.q)], axis=1)
            coef, *_ = np.linalg.lstsq(basis, excess, rcond=None)
            best.append((float(np.sum((basis @ coef) ** 2)), n, float(np.arctan2(coef[1], coef[0]))))
        best.sort(reverse=True)
        return [{"poles": float(n), "phase": phase} for _, n, phase in best[:2]]
