"""Accuracy of the contact law, beyond which an effect of the contact itself may be named.

Parameters of a simulated contact are the solver's: its stiffness depends on the number of simultaneous points, and
its restitution does not depend on speed. By Hunt and Crossley 1975 (Coefficient of restitution interpreted as damping
in vibroimpact, J. Appl. Mech. 42) restitution falls between 20 and 70 mm/s as much as if damping doubled.
"""

from __future__ import annotations

from vispeg.core.rules import RULES
from vispeg.worlds.world import World

STIFFNESS = "contact_stiffness"


def within(low: float, high: float) -> bool:
    """Return whether an interval of a factor reaches into the error of the contact law."""
    return low <= RULES.law and high >= 1 / RULES.law


def unsure(world: World, n_fixed: int) -> set[str]:
    """Return labels of effects after the first `n_fixed` that the law's error may explain: kept, but tentative."""
    out = set()
    for e in world.effects[n_fixed:]:
        if e.effect == STIFFNESS:
            (scale,) = e.params.values()
            low, high = (scale.value if end is None else end for end in (scale.low, scale.high))
            if within(low, high):
                out.add(e.label)
    return out
