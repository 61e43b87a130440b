"""Elasto-plastic hysteresis: springs that slip one after the other, the presliding of gear teeth and cable sheaths.

Source: the elements are those of `vispeg.effects.common.presliding` (Iwan 1966).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.presliding import pull, slack, softened, yielding


class Hysteresis(Effect):
    """Elastoplastic elements in parallel with the joint."""

    name = "hysteresis"
    family = "joint"
    params = {
        "torque": Param(0.0, 0.0, 30.0, "N m", start=0.5, doc="torque at which all elements slip"),
        "stiffness": Param(
            200.0, 5.0, 3000.0, "N m/rad", start=200.0, shape=True, scale="log", doc="before any element slips"
        ),
    }
    smooth = False
    contains = ("coulomb_friction",)

    def start(self, x, p):
        return slack(x.q)

    def torque(self, state, x, p):
        return pull(state, x.q, softened(p["stiffness"], x.inertia, x.h), p["torque"])

    def along(self, path, at, x, p):
        torque, stiffness = (np.broadcast_to(np.ravel(p[k]), path.shape[1:]) for k in ("torque", "stiffness"))
        stretch = [yielding(q, reach)[at] for q, reach in zip(path.T, torque / stiffness, strict=True)]
        return -stiffness * np.stack(stretch, axis=1)

    def guesses(self, look):
        return [{"stiffness": 50.0}, {"stiffness": 500.0}]
