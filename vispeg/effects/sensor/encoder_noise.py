"""Encoder noise: angle and velocity readings have independent Gaussian noise, new at every tick.

No MuJoCo mechanism: controllers here read angles, not sensors. Each simulation draws from a random stream that `seed`
determines, so a world can be replayed and does not depend on the others of its batch. Source of the range: 0.001 to
0.01 rad, the SVRC's guide (docs/sources.md).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import in_scene
from vispeg.effects.common.row_noise import keys, normal


class EncoderNoise(Effect):
    """White noise of measured angle and velocity."""

    name = "encoder_noise"
    family = "sensor"
    searchable = False
    order = 92
    smooth = False
    params = {
        "sd": Param(0.0, 0.0, 0.02, "rad", start=1e-3, doc="standard deviation of an angle"),
        "velocity": Param(0.0, 0.0, 0.5, "rad/s", start=0.01, doc="standard deviation of a velocity"),
        "seed": Param(0.0, 0.0, 2.0**31 - 1, "1", start=0.0, shape=True, doc="random seed"),
    }

    def targets(self, model):
        return in_scene(model, *model.joints)

    def start(self, x, p):
        lane = np.arange(2 * x.q.shape[1])
        key = keys(self.name, np.concatenate([p["seed"], p["seed"]], axis=1), lane)
        return {"tick": np.zeros(len(x.q), int), "key": key}

    def observe(self, state, q, dq, x, p):
        nj, tick, key = q.shape[1], state["tick"], state["key"]
        if (p["sd"] > 0).any():
            q = np.where(p["sd"] > 0, q + p["sd"] * normal(key[:, :nj], tick), q)
        if (p["velocity"] > 0).any():
            dq = np.where(p["velocity"] > 0, dq + p["velocity"] * normal(key[:, nj:], tick), dq)
        state["tick"] = tick + 1
        return q, dq
