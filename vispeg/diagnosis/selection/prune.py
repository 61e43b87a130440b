"""Backward deletion: remove effects that are superfluous once others have been added.

The fit without an effect is predicted from the derivatives. So the test of an effect needs no fit: on the fitted
recordings it uses the predicted residual (cross-fitted), on the held-out ones one rollout. A fit is made only when
something is removed. First, members of groups that are useless on the fitted recordings are removed together, unless
the held-out error then rises beyond chance. Then effects that the held-out recordings do not need are removed one by
one. One that lowers the held-out error beyond chance, but by no visible share, stays unnamed (`State.slight`). The
first `n_fixed` effects of a world are not fitted and stay.
"""

from __future__ import annotations

from scipy import stats

from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.dictionary import null_of
from vispeg.diagnosis.findings import Gain
from vispeg.diagnosis.selection.cross import reduced
from vispeg.diagnosis.selection.searching import Searching, Testing
from vispeg.diagnosis.selection.state import State, without


def prune(search: Searching, state: State) -> None:
    """Remove effects that are not needed, the least needed first, and refit the rest; at least one effect stays."""
    together = True
    while state.fit is not None and len(state.added) > 1:
        useless = _useless_members(search, state) if together else []
        dropped = useless or _least_needed(search, state)
        if not dropped:
            return
        gone = [state.world.effects[k] for k in dropped]
        world, columns = without(state.world, gone), state.derivatives(gone)
        (fit,) = search.fits([world], state.n_fixed, iterations=4, columns=[columns])
        loss = search.judge.losses([fit.world])[0]
        benefit = search.judge.gain(loss, state.loss)
        # the refit shows more error than was predicted from derivatives: nothing is removed
        worse = search.judge.mean(loss) > (1.0 + RULES.drop_rise) * search.judge.mean(state.loss)
        if worse or (useless and benefit.mean > 0 and benefit.z > RULES.drop_chance):
            if not useless:
                return
            together = False
            continue
        search.say(f"no longer needed: {', '.join(e.label for e in gone)}")
        state.take(fit, loss)
        state.cross = search.cross.loss_of(fit, fit.residual)
        state.slight = frozenset()  # those were of the model before


def _useless_members(search: Searching, state: State) -> list[int]:
    """Return the indices of group members that are useless on the fitted recordings."""
    fit, gone = state.fit, []
    assert fit is not None
    null = null_of(fit)
    asked = [k for k in range(state.n_fixed, len(state.world.effects)) if state.grouped(state.world.effects[k])]
    best = search.cross.loss(fit.residual, fit.jacobian)
    while len(asked) > len(gone) and len(state.added) - len(gone) > 1:
        tried = []
        for k in asked:
            if k in gone:
                continue
            out = [i for i, a in enumerate(fit.space.axes) if a.index in {*gone, k}]
            _, residual, columns = reduced(fit, out, null)
            loss = search.cross.loss(residual, columns)
            gain = search.cross.judge.gain(loss, best)
            tried.append((gain.z, k, loss, gain))
        z, k, loss, gain = min(tried, key=lambda t: t[0])
        if z >= RULES.tie_sigma and _matters(search, state, k, gain):
            break
        gone.append(k)
        best = loss
    return gone


def _least_needed(search: Searching, state: State) -> list[int]:
    """Return, as a list, the index of the effect that held-out recordings need least; empty if they need all of them.

    `state.slight` becomes the other effects that remove no visible share.
    """
    fit = state.fit
    assert fit is not None
    null, places = null_of(fit), list(range(state.n_fixed, len(state.world.effects)))
    worlds, crossed = [], []
    for k in places:
        out = [i for i, a in enumerate(fit.space.axes) if a.index == k]
        u, residual, columns = reduced(fit, out, null)
        placed = state.world.effects[k]
        worlds.append(fit.space.at(u).without(placed.effect, placed.where))
        crossed.append(search.cross.loss(residual, columns))
    losses = search.judge.losses(worlds)
    gains = [
        search.judge.gain(loss, state.loss, (cross, state.cross)) for loss, cross in zip(losses, crossed, strict=True)
    ]
    hardly = [i for i, k in enumerate(places) if not search.needed(state, k, gains[i])]
    chance = stats.norm.isf(RULES.discoveries)
    weak = [i for i in hardly if search.judge.gain(losses[i], state.loss).z < chance]
    least = min(weak, key=lambda i: gains[i].mean, default=None)
    state.slight = frozenset(state.world.effects[places[i]].label for i in hardly if i != least)
    return [] if least is None else [places[least]]


def needed(search: Testing, state: State, k: int, gain: Gain) -> bool:
    """Return whether the effect at index `k` lowers the held-out error beyond chance, and visibly, by `gain`."""
    sure = RULES.tie_sigma if state.grouped(state.world.effects[k]) else stats.norm.isf(RULES.level)
    return gain.z >= sure and _matters(search, state, k, gain)


def _matters(search: Testing, state: State, k: int, gain: Gain) -> bool:
    """Return whether `gain`, the improvement by the effect at index `k`, is a visible share of the error.

    For a member of a group, a visible share of its own joint's error is enough.
    """
    placed, joints = state.world.effects[k], search.evidence.items[0].robot.joints
    local = gain.joints[joints.index(placed.where)] if placed.where in joints and state.grouped(placed) else 0.0
    return max(gain.relative, local) >= search.evidence.least_gain
