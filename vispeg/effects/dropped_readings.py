"""Dropped readings: with probability `chance` a reading does not arrive and the last one stands in for it.

Joints with the same seed lose the same ticks, as in a lost packet; drops are independent from tick to tick. No MuJoCo
mechanism. Each simulation draws from a stream keyed by the shape parameter `seed`. Source of the range: 0.1 to 1 %,
practitioners' sim-to-real article.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects._parts import in_scene
from vispeg.effects._row_noise import uniform


class DroppedReadings(Effect):
    """Readings that are missing now and then."""

    name = "dropped_readings"
    kind = "contact"
    order = 98
    smooth = False
    params = {
        "chance": Param(0.0, 0.0, 0.5, "1", start=0.01, doc="probability that a reading is lost"),
        "seed": Param(0.0, 0.0, 2.0**31 - 1, "1", start=0.0, shape=True, doc="of the stream"),
    }

    def targets(self, model):
        return in_scene(model, *model.joints)

    def start(self, x, p):
        return {"tick": np.zeros(len(x.q), int), "q": np.full_like(x.q, np.nan), "dq": np.full_like(x.q, np.nan)}

    def observe(self, state, q, dq, x, p):
        lost = uniform(self.name, p["seed"], state["tick"], 0) < p["chance"]
        lost &= ~np.isnan(state["q"])  # the first reading always arrives
        q, dq = np.where(lost, state["q"], q), np.where(lost, state["dq"], dq)
        state["tick"], state["q"], state["dq"] = state["tick"] + 1, q, dq
        return q, dq
