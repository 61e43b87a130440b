"""Restitution: a part's contacts return at least the fraction `e` of the speed of an impact.

A contact is a spring and dashpot that cannot pull, so bodies part when its force, not its depth, is back to zero. With
damping ratio z < 1 that gives `e = exp(-2 z acos(z) / sqrt(1 - z^2))` (Schwager and Poeschel 2007, Granular Matter 9,
465, no attraction; for z > 1 acosh and z^2 - 1). The textbook's `z = -ln e / sqrt(pi^2 + ln^2 e)` lets the contact pull
and is this law's limit for little damping: at z = 0.3 it gives e = 0.37, this law 0.45. Native mechanism:
`geom_solref`, with the damping ratio for e and the same stiffness, see `vispeg.effects.common.solref`. A contact whose
own damping ratio gives more restitution than `e` does not change. Applied after contact_damping.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import changed, touching
from vispeg.effects.common.solref import damping_ratio, times


def rebound(ratio: np.ndarray) -> np.ndarray:
    """Return the coefficient of restitution of a contact with this damping ratio (>= 0)."""
    z = np.asarray(ratio, float)
    under, over = np.minimum(z, 1 - 1e-9), np.maximum(z, 1 + 1e-9)
    below = np.arccos(under) / np.sqrt(1 - under**2)
    above = np.arccosh(over) / np.sqrt(over**2 - 1)
    return np.exp(-2 * z * np.where(z < 1, below, above))


_RATIO = np.geomspace(20.0, 1e-4, 8192)  # damping ratios in falling order, so that restitution rises, for `ratio`
_REBOUND = rebound(_RATIO)


def ratio(e: np.ndarray) -> np.ndarray:
    """Return the damping ratio of a contact with coefficient of restitution e in (0, 1)."""
    return np.exp(np.interp(e, _REBOUND, np.log(_RATIO)))


class Restitution(Effect):
    """Coefficient of restitution of a contact."""

    name = "restitution"
    family = "contact"
    order = 60
    params = {"e": Param(0.0, 0.0, 0.98, "1", start=0.5, doc="least coefficient of restitution")}
    writes = frozenset({"geom_solref"})
    needs = "blow"

    def targets(self, model):
        return touching(model)

    def write(self, fields, p):
        solref = fields["geom_solref"]
        for at, e in changed(fields, p["e"], 0.0):
            own = damping_ratio(solref[at])
            share = np.divide(ratio(e), own, out=np.ones_like(own), where=own > ratio(e))
            solref[at] = times(solref[at], damping=share)
