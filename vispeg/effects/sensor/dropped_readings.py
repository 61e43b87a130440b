"""Dropped readings: with probability `chance` a reading does not arrive, and the last one is repeated.

Joints with the same seed lose the readings of the same ticks, as in a lost packet; ticks are independent. No MuJoCo
mechanism. Each simulation draws from a random stream that `seed` determines. Source of the range: 0.1 to 1 %,
the SVRC's guide (docs/sources.md).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import in_scene
from vispeg.effects.common.row_noise import keys, uniform


class DroppedReadings(Effect):
    """Lost joint readings; the last one is repeated."""

    name = "dropped_readings"
    family = "sensor"
    searchable = False
    order = 98
    smooth = False
    params = {
        "chance": Param(0.0, 0.0, 0.5, "1", start=0.01, doc="probability that a reading is lost"),
        "seed": Param(0.0, 0.0, 2.0**31 - 1, "1", start=0.0, shape=True, doc="random seed"),
    }

    def targets(self, model):
        return in_scene(model, *model.joints)

    def start(self, x, p):
        last = np.full((2, *x.q.shape), np.nan)
        return {"tick": np.zeros(len(x.q), int), "key": keys(self.name, p["seed"], 0), "q": last[0], "dq": last[1]}

    def observe(self, state, q, dq, x, p):
        lost = uniform(state["key"], state["tick"]) < p["chance"]
        if lost.any():
            lost &= ~np.isnan(state["q"])  # the first reading always arrives
            q, dq = np.where(lost, state["q"], q), np.where(lost, state["dq"], dq)
        state["tick"], state["q"], state["dq"] = state["tick"] + 1, q, dq
        return q, dq
