"""Replace the errors of several links by one body: one effect added, several removed.

A search by single steps may explain a load at the flange by masses and centres of the last links. If one effect is
exchanged for one, the search cannot get from there to the load alone, although that has fewer parameters. The first
`n_fixed` effects of a world are not fitted.
"""

from __future__ import annotations

from vispeg.core.effect import EffectInstance, effect, searchable
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.screen import candidates
from vispeg.diagnosis.findings import Score
from vispeg.diagnosis.selection.aliases import become, lacking, overtakes
from vispeg.diagnosis.selection.searching import Searching
from vispeg.diagnosis.selection.state import State


def gathered(search: Searching, state: State, n_fixed: int) -> bool:
    """Replace all link effects of the search by one body with mass and position, if that is better.

    Return whether they were replaced; `state` is then the new one.
    """
    links = of_links(search, state, n_fixed)
    if not links or state.fit is None:
        return False
    kinds = [kind.name for kind in searchable().values() if kind.family == "body" and kind.moments]
    places = [p for p in candidates(search.evidence, state.world, []) if p[0] in kinds]
    if not places:
        return False
    search.say(f"{', '.join(name for name, _ in places)} in the place of {', '.join(e.label for e in links)}")
    other = lacking(search, state, links, n_fixed)
    scores: list[Score] = search.screened_alone(
        other.world, other.residual, other.fit, places, search.missing(other.world)
    )
    trials = search.try_all(other, scores, n_fixed, search.tested(state)) if scores else []
    best = next((t for t in trials if not t.rejected), None)
    if best is None:
        return False
    search.take(other, best, trials, n_fixed)
    if not overtakes(search, state, other, n_fixed, RULES.gather_steps):
        return False
    become(state, other)
    return True


def of_links(search: Searching, state: State, n_fixed: int) -> list[EffectInstance]:
    """Return the effects of single links that a search added."""
    links = set(search.evidence.items[0].robot.links)
    return [e for e in state.world.effects[n_fixed:] if effect(e.effect).family == "body" and e.where in links]
