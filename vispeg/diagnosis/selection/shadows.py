"""Effects of joints and drives at their bounds where a search ends: it goes on without them, and what is better stays.

A voltage limit of a wrist at its least torque mimics friction, rotor and bias together, and none of the three gains
beside it: one out, and several in.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from vispeg.core.effect import effect
from vispeg.diagnosis.evidence.signatures import at_bound
from vispeg.diagnosis.selection.state import State, without

if TYPE_CHECKING:
    from vispeg.diagnosis.selection.search import Search

BETTER = 0.01  # of the held-out squared error, that a world without them must be better by
STEPS = 3  # that it may take to be


def cast_out(search: Search, state: State, n_fixed: int) -> bool:
    """Takes out of a state what stands at a bound where a search without it gets further; whether it did."""
    gone = [e for e in state.world.effects[n_fixed:] if effect(e.effect).family in ("joint", "drive") and at_bound(e)]
    if not gone or state.fit is None:
        return False
    world = without(state.world, gone)
    search.say(f"going on without {', '.join(e.label for e in gone)}: at a bound")
    if len(world.effects) > n_fixed:
        (fit,) = search.fits([world], n_fixed, columns=[state.derivatives(gone)])
        world, residual = fit.world, fit.residual
    else:
        fit, residual = None, search.evidence.residuals([world])[0]
    loss = search.judge.losses([world])[0]
    cross = search.cross.loss_of(fit, residual)
    other = replace(state, world=world, loss=loss, residual=residual, fit=fit, cross=cross, steps=[*state.steps])
    for _ in range(STEPS):
        if not (search.worth_it(other, n_fixed) and search.advance(other, n_fixed)) or other.fit is None:
            return False
        if search.judge.gain(state.loss, other.loss).relative >= BETTER:
            state.take(other.fit, other.loss)
            state.cross, state.steps = other.cross, other.steps
            return True
    return False
