"""Load-dependent friction: the gear's dry friction grows with the torque it carries.

`level = coefficient |tau|`, where tau is the torque on the link in the last physics step. Below that level the teeth
bend elastically, which a good encoder resolves. Sources: Duclusaud et al., "Extended friction models for the physics
simulation of servo actuators" (BAM), 2024, model M4's load term; the presliding is that of
`vispeg.effects.common.presliding` (Iwan 1966).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.presliding import pull, slack, softened, yielding


class LoadFriction(Effect):
    """Dry friction proportional to the transmitted torque."""

    name = "load_friction"
    family = "joint"
    params = {
        "coefficient": Param(0.0, 0.0, 0.5, "1", start=0.05, doc="friction torque per transmitted torque"),
        "stiffness": Param(1e5, 100.0, 1e6, "N m/rad", start=1e5, shape=True, scale="log", doc="before it slips"),
    }

    def stable_step(self, p):
        return 1e-3  # at 2 ms the lag of the friction level moves the joint by a multiple of an encoder's noise

    def start(self, x, p):
        return slack(x.q)

    def torque(self, state, x, p):
        return pull(state, x.q, softened(p["stiffness"], x.inertia, x.h), p["coefficient"] * np.abs(x.tau))

    def along(self, path, at, x, p):
        # the stretch is computed at the mean load, and its torque scaled to each sample's; for loads within half of the
        # mean this is right to a few percent
        load = np.abs(x.tau)
        mean = np.maximum(load.mean(axis=0), 1e-9)
        stiffness, coefficient = (np.broadcast_to(np.ravel(p[k]), path.shape[1:]) for k in ("stiffness", "coefficient"))
        stretch = [yielding(q, reach)[at] for q, reach in zip(path.T, coefficient * mean / stiffness, strict=True)]
        return -stiffness * np.stack(stretch, axis=1) * load / mean
