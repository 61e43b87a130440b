"""Remove aliases: accepted effects that imitate missing ones.

Three kinds of effects are suspected:

- Effects at a bound: a voltage limit of a wrist at its lowest torque imitates friction, rotor and bias together.
- A delay of one joint if there is one of all joints too: a lag of a wrist imitates its rotor's inertia.
- If the residual is large: effects, other than those that every arm has, in the joint with the largest error.

With an alias in the model, no missing effect improves the fit on its own, so exchanges of one effect for one fail. When
a search ends, it is therefore continued without the aliases, and the better result is kept. An alias at a bound that
was added together with others is removed at once. The first `n_fixed` effects of a world are not fitted and stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.screen import candidates
from vispeg.diagnosis.evidence.signatures import at_bound
from vispeg.diagnosis.findings import Score
from vispeg.diagnosis.selection.searching import Searching
from vispeg.diagnosis.selection.state import State, without


def remove_stuck_members(search: Searching, state: State, before: np.ndarray, score: Score, n_fixed: int) -> None:
    """Remove the members at a bound of the group just added, if the others alone beat the loss `before` the addition.

    `score` is the group.
    """
    gone = [e for e in _stuck(state, n_fixed) if score.has(e)]
    if gone and len(gone) < score.count:
        other = lacking(search, state, gone, n_fixed)
        if search.judge.gain(before, other.loss).relative >= search.evidence.least_gain:
            search.say(f"without {', '.join(e.label for e in gone)}: at a bound")
            become(state, other)


def remove_aliases(search: Searching, state: State, n_fixed: int) -> bool:
    """Remove one kind of suspected alias from a state if the search without it gets further; return whether it did.

    The same removal is not tried twice with the same other effects, so that the search terminates.
    """
    if state.fit is None:
        return False
    kinds = {
        "at a bound": _stuck(state, n_fixed),
        "all joints have a delay": _shared_too(state, n_fixed),
        "not what every arm has, in the joint with the greatest error": _uncommon(search, state, n_fixed),
    }
    for why, gone in kinds.items():
        asked = (state.world.label, *(e.label for e in gone))
        if not gone or asked in state.tried_removals:
            continue
        state.tried_removals.add(asked)
        search.say(f"going on without {', '.join(e.label for e in gone)}: {why}")
        other = lacking(search, state, gone, n_fixed)
        if overtakes(search, state, other, n_fixed, RULES.on_steps):
            become(state, other)
            return True
    return False


def overtakes(search: Searching, state: State, other: State, n_fixed: int, steps: int) -> bool:
    """Return whether another state is better than `state`, or becomes so within `steps` steps of its search."""
    for k in range(steps + 1):
        if other.fit is not None and search.judge.gain(state.loss, other.loss).relative >= RULES.exchange:
            return True
        if k == steps or not (search.worth_it(other, n_fixed) and search.advance(other, n_fixed)):
            return False
    return False


def _stuck(state: State, n_fixed: int) -> list[EffectInstance]:
    """Return the added effects of joints and drives with a magnitude at a bound."""
    return [e for e in state.world.effects[n_fixed:] if effect(e.effect).family in ("joint", "drive") and at_bound(e)]


def _shared_too(state: State, n_fixed: int) -> list[EffectInstance]:
    """Return added effects of single joints of kinds that all joints may share (delays), if the world has a shared one.

    That one may be of another kind.
    """
    has_shared = any(effect(e.effect).shared and e.where == "all" for e in state.world.effects)
    return [e for e in state.world.effects[n_fixed:] if has_shared and effect(e.effect).shared and e.where != "all"]


def _uncommon(search: Searching, state: State, n_fixed: int) -> list[EffectInstance]:
    """Return the added effects of the joint with the largest error that not every arm has.

    Empty unless the error over all joints is large, or if the joint has all effects that every arm has, or if no other
    effects were added, as at the start of a search.
    """
    if search.judge.mean(state.loss) <= RULES.far * search.judge.floor(state.world):
        return []
    worst = search.evidence.items[0].robot.joints[int(np.argmax(state.loss.sum(axis=0)))]
    lacks = [name for name, where in candidates(search.evidence, state.world, [worst]) if where == worst]
    if not any(effect(name).common for name in lacks):
        return []
    added = state.world.effects[n_fixed:]
    gone = [e for e in added if e.where == worst and not effect(e.effect).common]
    return gone if len(gone) < len(added) else []


def lacking(search: Searching, state: State, gone: Sequence[EffectInstance], n_fixed: int) -> State:
    """Return the state without the effects `gone`, the others refitted; steps that added only such are dropped."""
    world, fit = without(state.world, gone), None
    if len(world.effects) > n_fixed:
        (fit,) = search.fits([world], n_fixed, columns=[state.derivatives(gone)])
        world, residual = fit.world, fit.residual
    else:
        residual = search.evidence.residuals([world])[0]
    loss, cross = search.judge.losses([world])[0], search.cross.loss_of(fit, residual)
    labels = {e.label for e in gone}
    steps = [s for s in state.steps if not {e.label for e in s[0].score.members} <= labels]
    return replace(state, world=world, loss=loss, residual=residual, fit=fit, cross=cross, steps=steps, last=[])


def become(state: State, other: State) -> None:
    """Set a state to another one, which was searched from it."""
    assert other.fit is not None
    state.take(other.fit, other.loss)
    state.cross, state.steps, state.last, state.screening = other.cross, other.steps, other.last, other.screening
    state.slight = other.slight
