"""Stribeck friction: dry friction that is greater at rest and falls as a film of lubricant builds up with speed.

`level = coulomb + excess exp(-(dq / velocity)^2)`, always against the motion. It sets the level of MuJoCo's
dry-friction constraint (`dof_frictionloss`) at each physics step; the native LuGre `dcmotor` would need a compiled
model for each candidate. Source: Armstrong-Helouvry et al., Automatica 30(7), 1994, eq. (5), exponent 2.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class StribeckFriction(Effect):
    """Dry friction with a peak at low speed."""

    name = "stribeck_friction"
    family = "joint"
    params = {
        "coulomb": Param(0.0, 0.0, 30.0, "N m", start=0.5, doc="friction torque at high speed"),
        "excess": Param(0.0, 0.0, 30.0, "N m", start=0.5, doc="additional breakaway torque at rest"),
        "velocity": Param(0.05, 0.005, 0.5, "rad/s", start=0.05, shape=True, scale="log", doc="Stribeck velocity"),
    }
    telling = ("excess",)
    contains = ("coulomb_friction",)
    grows_from = {"coulomb_friction": {"coulomb": "torque"}}

    def friction(self, state, x, p):
        return p["coulomb"] + p["excess"] * np.exp(-((x.dq / p["velocity"]) ** 2))

    def guesses(self, look):
        return [{"velocity": 0.02}, {"velocity": 0.1}]
