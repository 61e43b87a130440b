"""Dropped readings: with probability `chance` a reading does not arrive and the last one stands in for it.

A lost packet: all joints with the same chance lose the same ticks; drops are independent from tick to tick. No MuJoCo
mechanism. Each simulation draws from one stream keyed by the shape parameter `seed`. Source of the range: 0.1 to 1 %,
practitioners' sim-to-real article.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects._row_noise import RowNoise
from vispeg.effects._parts import in_scene


class DroppedReadings(Effect):
    """Readings that are missing now and then."""

    name = "dropped_readings"
    kind = "contact"
    order = 98
    smooth = False
    params = {
        "chance": Param(0.0, 0.0, 0.5, "1", start=0.01, doc="probability that a reading is lost"),
        "seed": Param(0.0, 0.0, 2.0**31, "1", start=0.0, shape=True, doc="of the stream"),
    }

    def targets(self, model):
        return in_scene(model, *model.joints)

    def start(self, x, p):
        uniform = RowNoise(self.name, p["seed"], 1, lambda g, shape: g.random(shape), (p["chance"] > 0).any(axis=1))
        return {"uniform": uniform, "last": None}

    def observe(self, state, q, dq, x, p):
        lost = (state["uniform"]() < p["chance"]) & (state["last"] is not None)
        if state["last"] is not None:
            q, dq = np.where(lost, state["last"][0], q), np.where(lost, state["last"][1], dq)
        state["last"] = q, dq
        return q, dq
