"""Wrench noise: the wrist's sensor reads forces and torques with independent Gaussian noise, new at every tick.

No MuJoCo mechanism: its engine does not apply a sensor's `noise`. Each simulation draws from a random stream that
`seed` determines, so a world can be replayed and does not depend on the others of its batch. Source: the noise that
data sheets of force sensors state, as one standard deviation for forces and one for torques.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.row_noise import keys, normal
from vispeg.effects.common.wrist import WristEffect, six


class WrenchNoise(WristEffect):
    """White noise of wrench readings."""

    name = "wrench_noise"
    order = 92
    smooth = False
    params = {
        "force": Param(0.0, 0.0, 10.0, "N", start=0.2, doc="standard deviation of each force"),
        "torque": Param(0.0, 0.0, 1.0, "N m", start=0.01, doc="standard deviation of each torque"),
        "seed": Param(0.0, 0.0, 2.0**31 - 1, "1", start=0.0, shape=True, doc="random seed"),
    }

    def start(self, x, p):
        lanes = np.arange(6)
        return {"tick": np.zeros(len(x.q), int), "key": keys(self.name, np.repeat(p["seed"], 6, axis=1), lanes)}

    def wrench(self, state, wrench, x, p):
        sd, tick = six(p["force"], p["torque"]), state["tick"]
        state["tick"] = tick + 1
        return np.where(sd > 0, wrench + sd * normal(state["key"], tick), wrench) if (sd > 0).any() else wrench
