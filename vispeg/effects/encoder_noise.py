"""Encoder noise: every reading of angle and velocity is off by a Gaussian of its own, white from tick to tick.

No MuJoCo mechanism: controllers here read angles, not sensors. Each simulation draws from one stream
keyed by the shape parameter `seed`, so a world replays and a row does not depend on its neighbours. Source of the
range: 0.001 to 0.01 rad, practitioners' sim-to-real article.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects._row_noise import RowNoise
from vispeg.effects._parts import in_scene


class EncoderNoise(Effect):
    """Noisy readings."""

    name = "encoder_noise"
    kind = "contact"
    order = 92
    smooth = False
    params = {
        "sd": Param(0.0, 0.0, 0.02, "rad", start=1e-3, doc="standard deviation of an angle"),
        "velocity": Param(0.0, 0.0, 0.5, "rad/s", start=0.01, doc="standard deviation of a velocity"),
        "seed": Param(0.0, 0.0, 2.0**31, "1", start=0.0, shape=True, doc="of the stream"),
    }

    def targets(self, model):
        return in_scene(model, *model.joints)

    def start(self, x, p):
        active = (p["sd"] > 0).any(axis=1) | (p["velocity"] > 0).any(axis=1)
        return RowNoise(self.name, p["seed"], 2 * p["sd"].shape[1], lambda g, shape: g.standard_normal(shape), active)

    def observe(self, state, q, dq, x, p):
        noise = state()
        nj = q.shape[1]
        q = np.where(p["sd"] > 0, q + p["sd"] * noise[:, :nj], q)
        return q, np.where(p["velocity"] > 0, dq + p["velocity"] * noise[:, nj:], dq)
