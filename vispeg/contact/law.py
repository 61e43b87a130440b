"""How far a law of contact may be off before an effect of the contact itself is named.

The numbers of a simulated contact are the solver's: how many points touch at once decides how stiff it is, and its
restitution does not depend on speed. By Hunt and Crossley 1975 (Coefficient of restitution interpreted as damping in
vibroimpact, J. Appl. Mech. 42) restitution falls between 20 and 70 mm/s as it does where damping doubles.
"""

from __future__ import annotations

from vispeg.core.rules import RULES
from vispeg.worlds.world import World

STIFFNESS = "contact_stiffness"


def within(low: float, high: float) -> bool:
    """Whether an interval of a factor reaches what another law of contact may be off by."""
    return low <= RULES.law and high >= 1 / RULES.law


def unsure(world: World, n_fixed: int) -> set[str]:
    """Labels of effects after the first `n_fixed` that may be of the law: they stay in the model, and are tentative."""
    out = set()
    for e in world.effects[n_fixed:]:
        if e.effect == STIFFNESS:
            (scale,) = e.params.values()
            low, high = (scale.value if end is None else end for end in (scale.low, scale.high))
            if within(low, high):
                out.add(e.label)
    return out
