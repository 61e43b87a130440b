"""Contact stiffness: a part's contacts are `scale` times as stiff as nominal: any load presses them 1 / scale as deep.

At rest under a load f, N, a contact is pressed r deep, m, by `f = d^2 / (1 - d) K r / (d1^2 w)`. Here d is the
impedance at the depth r, from d0 at the surface to d1 at full depth (`geom_solimp`); K, 1/s^2, the stiffness of
`geom_solref`, 1 / (T z)^2 with time constant T, s, and damping ratio z; and w, 1/kg, the inverse weight of what the
contact moves (`body_invweight0`). Native mechanism: the odds `d / (1 - d)` at d0 are scaled; d1 and K are set so that
the law holds at the surface and at full depth, in either form of `geom_solref` (see `vispeg.effects.common.solref`);
and the width, the depth from d0 to d1, is divided by `scale`. So T hardly changes: at a `scale` of 0.1 from 0.0200 to
0.0226 s with MuJoCo's own d0 and d1, 0.9 and 0.95. A softer K alone would do the same at rest, but take T to 0.063 s,
and contacts would respond late. MuJoCo keeps d within limits; where the odds would leave them, K is scaled instead.

Impacts follow another law: at a `scale` of 0.1 the peak force of a ball falls by 28 % with MuJoCo's own d0 and d1; that
of the part that falls flat on the fixture of the cell, on four contacts, rises by 14 %. Between surface and full depth
the law is not exact. With MuJoCo's own `geom_solimp` the depth is up to 2.0 % less at a `scale` of 0.25 and 5.1 % less
at 0.02 (2.5 % and 6.3 % with another midpoint or power); more, the farther apart the odds of d0 and d1 are. In the cell
it is 3 % less at 15 N per contact and 0.02. MuJoCo keeps T above two physics steps. A T at that limit cannot be
shortened where K is scaled instead: at a `scale` of 20 a contact is then 2.0 times as soft as meant with d0 and d1 of
0.99 and 0.999, and not stiffer than nominal with 0.999 and 0.9999.
Source: MuJoCo 4.0 manual, Modeling, Solver parameters.
"""

from __future__ import annotations

import mujoco
import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import changed, touching
from vispeg.effects.common.solref import times

LIMITS = mujoco.mjMINIMP, mujoco.mjMAXIMP  # between which MuJoCo keeps the impedance


def scaled(solref: np.ndarray, solimp: np.ndarray, scale: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Return `solref` (..., 2) and `solimp` (..., 5) of contacts that are `scale` (...) times as stiff."""
    d = np.clip(solimp[..., :2], *LIMITS)
    (least, most), bears = _bears(np.array(LIMITS)), _bears(d)
    # With scaled odds d becomes d' = scale d / (1 - d + scale d); then d'^2 / (1 - d') is `share` times d^2 / (1 - d).
    # With the same share at d1 one K makes the law hold at both.
    share = scale**2 / (1 - d[..., 0] + scale * d[..., 0])
    share = np.clip(share, least / bears.min(axis=-1), most / bears.max(axis=-1))  # K takes the rest
    new = 2 / (1 + np.sqrt(1 + 4 / (share[..., None] * bears)))  # the d' > 0 that solves d'^2 / (1 - d') = share bears
    rate = np.sqrt(scale / share) * new[..., 1] / d[..., 1]  # K's root: share K / d1^2 is to be `scale` times as large
    width = solimp[..., 2:3] / np.asarray(scale)[..., None]
    return times(solref, stiffness=rate**2, damping=rate), np.concatenate([new, width, solimp[..., 3:]], -1)


def _bears(d: np.ndarray) -> np.ndarray:
    """Return `d^2 / (1 - d)` of an impedance d, to which the load per depth at rest is proportional."""
    return d**2 / (1 - d)


class ContactStiffness(Effect):
    """Stiffness of a contact."""

    name = "contact_stiffness"
    family = "contact"
    params = {"scale": Param(1.0, 0.005, 20.0, "1", start=0.5, scale="log", doc="stiffness at rest over nominal")}
    writes = frozenset({"geom_solref", "geom_solimp"})
    stage = "compliance"
    # softer ones by factors of 3.5; whatever is stiffer changes a depth by less than that depth
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
