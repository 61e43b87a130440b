"""Contact stiffness: a part's contacts are `scale` times as stiff as nominal: any load presses them 1 / scale as deep.

At rest under a load f, a contact is pressed r deep by `f = d / (1 - d) k r / w` with `k = K d / d1^2`. Here d is the
impedance at the depth r and d1 that at full depth (`geom_solimp`), K the stiffness of `geom_solref`, 1 / (T z)^2 with
time constant T and damping ratio z, and w the inverse weight of what the contact moves. Native mechanism: the odds
`d / (1 - d)` of `geom_solimp` are scaled, its width, the depth over which a contact grows stiffer, is divided by
`scale`, and T of `geom_solref` is set so that k stays, in either of its forms (see `vispeg.effects.common.solref`). A
longer T alone would do the same at rest, but contacts would respond late. An impact takes T whatever the impedance: its
peak force falls only by a fifth at a `scale` of 0.1. At 15 N per contact and a `scale` of 0.02 the depth is 5 % less
than 1 / scale times nominal. MuJoCo keeps T above two physics steps; near that limit a contact is up to 1.5 times as
soft. Source: MuJoCo 4.0 manual, Modeling, Solver parameters.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import changed, touching
from vispeg.effects.common.solref import times


def scaled(solref: np.ndarray, solimp: np.ndarray, scale: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Return `solref` (..., 2) and `solimp` (..., 5) of contacts that are `scale` (...) times as stiff."""
    d, d1, width = np.moveaxis(solimp[..., :3], -1, 0)
    soft, soft1 = (scale * e / (1 - e + scale * e) for e in (d, d1))
    rate = np.sqrt(d / soft) * soft1 / d1
    new = np.concatenate([np.stack([soft, soft1, width / scale], -1), solimp[..., 3:]], -1)
    return times(solref, stiffness=rate**2, damping=rate), new


class ContactStiffness(Effect):
    """Stiffness of a contact."""

    name = "contact_stiffness"
    family = "contact"
    params = {"scale": Param(1.0, 0.005, 20.0, "1", start=0.5, scale="log", doc="stiffness at rest over nominal")}
    writes = frozenset({"geom_solref", "geom_solimp"})
    stage = "compliance"
    sizes = {"scale": (0.02, 0.07, 0.25, 3.0)}
    shown_by = ("press", "hard-press")
    told_from = {"fixture_compliance": "hard-press"}
    needs = "two forces"

    def targets(self, model):
        return touching(model)

    def write(self, fields, p):
        solref, solimp = fields["geom_solref"], fields["geom_solimp"]
        for at, scale in changed(fields, p["scale"], 1.0):
            solref[at], solimp[at] = scaled(solref[at], solimp[at], scale)
