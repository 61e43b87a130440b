"""Give competitors that are nearly confounded with the chosen effect its free parameters before they are judged worse.

Screening tests the sizes of each parameter separately and frees the promising ones. It may free a parameter of one
effect and not of a similar one: a grip compliant along x alone cannot compete with a fixture compliant along x and y.
"""

from __future__ import annotations

import numpy as np

from vispeg.contact.selection.profile import places, strongest
from vispeg.contact.selection.searching import ContactSearching
from vispeg.core.effect import EffectInstance, effect, told_apart_by
from vispeg.diagnosis.findings import Score
from vispeg.diagnosis.selection.state import State


def lacking(placed: EffectInstance, rival: EffectInstance) -> set[str]:
    """Return the parameters that one effect uses and a near-confounded other has but leaves at null."""
    kind = effect(rival.effect)
    if rival.effect == placed.effect or not told_apart_by(placed.effect, rival.effect):
        return set()
    acts = [k for k, v in placed.params.items() if v.value != effect(placed.effect).params[k].null]
    return {k for k in acts if k in kind.params and rival.params[k].value == kind.params[k].null}


def free_lacking(search: ContactSearching, placed: EffectInstance, rival: EffectInstance) -> bool:
    """Let fits free the parameters that a competitor lacks (see `lacking`); return whether it lacks any."""
    names = {(rival.effect, name) for name in lacking(placed, rival)}
    search.evidence.absent = search.evidence.absent - names
    return bool(names)


def refitted(search: ContactSearching, state: State) -> None:
    """Refit competitors of a single added effect that lacked one of its parameters, and fit those not tried before."""
    chosen = state.added
    if len(chosen) != 1 or len(state.steps) != 1:
        return
    (placed,), (taken, trials) = chosen, state.steps[0]
    world = state.world.without(placed.effect, placed.where)
    lone = {t.score.key: t.fit.world.effects[-1] for t in trials if not t.score.beside}
    others = [p for p in places(search.evidence, world) if p not in lone and lacking(placed, EffectInstance.of(*p))]
    felt = [s.placed for s in strongest(search.probed(world, others)) if s.gain > -np.inf] if others else []
    again = [rival for rival in (*lone.values(), *felt) if free_lacking(search, placed, rival)]
    if not again:
        return
    before = search.start(world, state.n_fixed)
    tried = search.try_all(before, [Score(rival, 0.0) for rival in again], search.tested(before))
    anew = {t.score.key: t.bare for t in tried}
    old = [t if t.score.beside else anew.pop(t.score.key, t) for t in trials]
    state.steps[0] = taken, [*old, *anew.values()]
