"""Which of several effects of contact the others can do without."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vispeg.contact.selection.form import form
from vispeg.diagnosis.selection.state import State

if TYPE_CHECKING:
    from vispeg.contact.selection.search import ContactSearch


def spared(search: ContactSearch, state: State, n_fixed: int) -> bool:
    """Takes out the effect of several that is needed least once the others are fitted anew; False where all are.

    What came in first may stand for what came in later, and no derivative tells: contacts come and go.
    """
    some = state.world.effects[n_fixed:]
    if state.fit is None or len(some) < 2:
        return False
    worlds = [state.world.without(e.effect, e.where) for e in some]
    search.say(f"leaving out {', '.join(e.label for e in some)}")
    fits = search.reduced(worlds, n_fixed)
    losses = search.judge.losses([f.world for f in fits])
    worse = [float(f.residual @ f.residual - state.residual @ state.residual) for f in fits]
    held = [float((loss - state.loss).sum()) for loss in losses]
    count = [len([a for a in state.fit.space.axes if a.index == n_fixed + k]) for k in range(len(some))]
    cost = state.fit.cost, search.judge.mean(state.loss)
    weak = [
        k
        for k, f in enumerate(fits)
        if worse[k] <= max(search.need(cost[0], count[k]), form(search.evidence.items, f.residual))
        or held[k] <= max(search.confirms(cost[1]), search.held_form(f.world))
    ]
    if not weak:
        return False
    k = min(weak, key=lambda k: worse[k] / count[k])
    search.say(f"not needed beside the others: {some[k].label}")
    search.lately = {}
    state.take(fits[k], losses[k])
    state.cross = search.cross.loss_of(fits[k], fits[k].residual)
    return True
