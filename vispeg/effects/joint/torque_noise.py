"""Torque noise: a random torque at a joint, such as the missing torque that a diagnosis leaves unexplained.

An Ornstein-Uhlenbeck process, stationary from the first step and exact at any step: `x' = a x + sqrt(1 - a^2) n`,
`a = exp(-h / time)`. Source: Uhlenbeck and Ornstein, Physical Review 36(5), 1930. No MuJoCo mechanism.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import in_scene
from vispeg.effects.common.row_noise import keys, normal


class TorqueNoise(Effect):
    """Random torque that no other effect explains."""

    name = "torque_noise"
    family = "joint"
    searchable = False
    smooth = False
    params = {
        "rms": Param(0.0, 0.0, 30.0, "N m", start=0.5, doc="root mean square of the torque"),
        "time": Param(0.1, 1e-3, 10.0, "s", start=0.1, shape=True, scale="log", doc="correlation time"),
        "seed": Param(0.0, 0.0, 2.0**31 - 1, "1", start=0.0, shape=True, doc="random seed"),
    }

    def targets(self, model):
        return in_scene(model, *model.joints)

    def start(self, x, p):
        key = keys(self.name, p["seed"], np.arange(x.q.shape[1]))
        tick = np.zeros(len(x.q), int)
        return {"tick": tick + 1, "key": key, "value": normal(key, tick)}

    def torque(self, state, x, p):
        value = state["value"]
        memory = np.exp(-x.h / p["time"])
        state["value"] = memory * value + np.sqrt(1.0 - memory**2) * normal(state["key"], state["tick"])
        state["tick"] = state["tick"] + 1
        return p["rms"] * value

    def side(self):
        return "link"
