"""A soft layer on the fixture, such as a gasket or tape: not in the library, but it looks like two effects of it."""

from __future__ import annotations

from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.findings import Verdict
from vispeg.worlds.world import World


def judged(verdict: Verdict, world: World, n_fixed: int) -> Verdict:
    """Change `identified` to `ambiguous` if a softer contact and a higher part were added, as a layer would look.

    If walls are hardly touched, no recording distinguishes a layer from these two effects.

    Args:
        verdict: the verdict of the search.
        world: the corrected model.
        n_fixed: number of effects given by the user.
    """
    if verdict.verdict != "identified":
        return verdict
    added = world.effects[n_fixed:]
    soft = next((e for e in added if e.effect == "contact_stiffness" and e.params["scale"].value < 1.0), None)
    high = next((e for e in added if _higher(e)), None)
    if soft is None or high is None:
        return verdict
    text = (
        f"{soft.label} with {high.label} is also what a soft layer on the fixture (a gasket, tape) looks like, "
        "which is no effect of the library: look whether one lies there"
    )
    return Verdict("ambiguous", text, partial=verdict.partial)


def _higher(placed: EffectInstance) -> bool:
    """Return whether an effect is a pose of which the whole interval makes parts touch sooner than nominal."""
    z = placed.params.get("z") if effect(placed.effect).posed else None
    return z is not None and (z.value if z.low is None else z.low) > 0.0
