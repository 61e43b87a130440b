"""RGB noise: linear light I in [0, 1] gets sensor noise of variance `shot I + read^2`.

The Poisson noise of photons is drawn as a Gaussian of the same variance. Source: Foi, Trimeche, Katkovnik and
Egiazarian, Practical Poissonian-Gaussian noise modeling and fitting for single-image raw-data, TIP 17(10), 2008,
eq. (3). Ranges: shot 1e-4 to 1e-2; read 0 to 0.05 in the SVRC's guide (docs/sources.md).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.field import normal
from vispeg.effects.common.light import LightEffect


class RgbNoise(LightEffect):
    """Shot and read-out noise, new in every frame."""

    name = "rgb_noise"
    channel = "light"
    order = 58
    random = True
    params = {
        "shot": Param(0.0, 0.0, 0.05, "1", start=0.002, doc="variance per unit of light (photon noise)"),
        "read": Param(0.0, 0.0, 0.1, "1", start=0.01, doc="standard deviation in the dark (electronics)"),
    }

    def light(self, frame, p, rng):
        shot, dark = np.asarray(p["shot"], np.float32), np.square(p["read"]).astype(np.float32)

        def noisy(light, row):
            noise = normal(rng[row], light.shape)
            noise *= np.sqrt(shot[row] * light + dark[row])
            noise += light
            return np.clip(noise, 0, 1, out=noise)

        return noisy
