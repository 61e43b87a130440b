"""Contact stiffness: a part's contacts are `scale` times as stiff as nominal: any load presses them 1 / scale as deep.

A contact at rest under a load f stands r deep by `f = d / (1 - d) k r / w`, with impedance d, `k = d / (d1 T z)^2` and
the inverse weight w of what it moves. Native mechanism: `geom_solimp`, whose odds `d / (1 - d)` are scaled, and whose
width, over which a contact grows harder, is divided by `scale`; `geom_solref` keeps k. A longer time constant T would
do the same at rest, but what touches would then answer late. A blow is answered in T whatever the impedance: its peak
falls by a fifth where `scale` is 0.1. At 15 N a contact and a `scale` of 0.02 it stands 5 % less deep than that.
MuJoCo keeps T above two steps: near them a contact is up to 1.5 times as soft.
Source: MuJoCo 4.0 manual, Modeling, Solver parameters.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import changed, touching


def scaled(solref: np.ndarray, solimp: np.ndarray, scale: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Contacts (..., 2) and (..., 5) that are `scale` (...) times as stiff."""
    d, d1, width = np.moveaxis(solimp[..., :3], -1, 0)
    soft, soft1 = (scale * e / (1 - e + scale * e) for e in (d, d1))
    time = solref[..., 0] * np.sqrt(soft / d) * d1 / soft1
    new = np.concatenate([np.stack([soft, soft1, width / scale], -1), solimp[..., 3:]], -1)
    return np.stack([time, solref[..., 1]], -1), new


class ContactStiffness(Effect):
    """Stiffness of a contact."""

    name = "contact_stiffness"
    family = "contact"
    params = {"scale": Param(1.0, 0.005, 20.0, "1", start=0.5, scale="log", doc="of the nominal stiffness at rest")}
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
