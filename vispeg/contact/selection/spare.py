"""Removal of contact effects that the others make superfluous, and of effects and parameters that may be absent."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.selection.form import form
from vispeg.contact.selection.likely import absent
from vispeg.contact.selection.profile import size_of
from vispeg.contact.selection.repeats import allowing
from vispeg.contact.selection.searching import ContactSearching
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.selection.state import State
from vispeg.identify.fit import Fit
from vispeg.worlds.world import World


def remove_unneeded(search: ContactSearching, state: State) -> bool:
    """Remove the effect that is needed least once the others are refitted.

    An early effect may imitate a later one. Derivatives cannot show this, because a change of a parameter makes
    contacts begin or end.

    Returns:
        False if all are needed, or if there are fewer than two.
    """
    added = state.added
    if state.fit is None or len(added) < 2:
        return False
    worlds = [state.world.without(e.effect, e.where) for e in added]
    search.say(f"leaving out {', '.join(e.label for e in added)}")
    fits = search.reduced(worlds, state.n_fixed)
    losses = search.judge.losses([f.world for f in fits])
    worse = [float(f.residual @ f.residual - state.residual @ state.residual) for f in fits]
    held = [float((loss - state.loss).sum()) for loss in losses]
    count = [len([a for a in state.fit.space.axes if a.index == state.n_fixed + k]) for k in range(len(added))]
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
    search.say(f"not needed with the others: {added[k].label}")
    search.remove(state, fits[k], losses[k])
    return True


def may_be_absent(placed: EffectInstance) -> bool:
    """Return whether an effect may be absent: it has intervals of its magnitudes, and all of them include null.

    Magnitudes without an interval do not count. The interval of a pose is widened by the arm's repeatability.
    """
    kind, wide = effect(placed.effect), allowing(placed)
    inside = []
    for k in kind.magnitudes:
        v = wide.params[k]
        if v.low is not None and v.high is not None:
            inside.append(v.low <= kind.params[k].null <= v.high)
    return bool(inside) and all(inside)


def too_small(placed: EffectInstance, least: Mapping[tuple[str, str], Mapping[str, float]]) -> bool:
    """Return whether every magnitude with a detectable size (`vispeg.contact.selection.shows_from`) is below it."""
    kind, sizes = effect(placed.effect), least.get((placed.effect, placed.where), {})
    under = []
    for k in kind.magnitudes:
        from_ = sizes.get(k, np.inf)
        if np.isfinite(from_):
            under.append(
                abs(size_of(kind.name, k, placed)) < (np.log(from_) if kind.params[k].scale == "log" else from_)
            )
    return bool(under) and all(under)


def remove_uncertain(search: ContactSearching, state: State) -> bool:
    """Remove an effect whose intervals include null or that is below its minimum detectable size; else return False.

    Acceptance is based on the best value only, while the interval covers all plausible values. An effect below its
    minimum detectable size may only imitate the error of an inexact contact law (`form`).
    """
    added = state.added
    gone = next((e for e in reversed(added) if may_be_absent(e) or too_small(e, search.least)), None)
    if gone is None:
        return False
    small = not may_be_absent(gone)
    search.say(f"{gone.label} {'is smaller than these recordings can show' if small else 'may be absent'}")
    world = state.world.without(gone.effect, gone.where)
    if len(added) > 1:
        (fit,) = search.reduced([world], state.n_fixed)  # the same fit as in `remove_unneeded`
        search.remove(state, fit, search.judge.losses([fit.world])[0])
        return True
    before = search.start(world, state.n_fixed)
    state.world, state.loss, state.residual = before.world, before.loss, before.residual
    state.fit, state.cross = before.fit, before.cross
    near = ", allowing for the arm's repeatability" if effect(gone.effect).posed else ""
    why = f"the interval of {gone.label} includes null{near}"
    if small:
        why = f"{gone.label} is smaller than its minimum detectable size in these recordings"
    state.last = [replace(t, rejected=t.rejected or why) for _, trials in state.steps for t in trials]
    state.steps = []
    return True


def sparse(evidence: ContactEvidence, fit: Fit, n_fixed: int, refit: Callable[[World], Fit]) -> Fit:
    """Refit without the magnitudes that may be null: all at once, or else one by one, the least needed first.

    Only the effects after the first `n_fixed` are considered, and each keeps at least one magnitude. The removed
    magnitudes are added to `evidence.absent`, so that later fits leave them at null.
    """
    idle = _idle(evidence, fit, n_fixed)
    for gone in (idle, idle[:1]) if idle else ():
        before = evidence.absent
        smaller = refit(_without(evidence, fit, gone))
        rise = float(smaller.residual @ smaller.residual - fit.residual @ fit.residual)
        if rise <= evidence.lasting * evidence.variance(fit.cost) * stats.chi2.isf(RULES.sparse_level, len(gone)):
            return sparse(evidence, smaller, n_fixed, refit)
        evidence.absent = before
    return fit


def _idle(evidence: ContactEvidence, fit: Fit, n_fixed: int) -> list[int]:
    """Return the coordinates that may be set to null, the least needed first; each effect keeps its most needed one."""
    axes, kinds, out = fit.space.axes, [effect(e.effect) for e in fit.world.effects], []
    count = Counter(a.index for a in axes if a.index >= n_fixed)
    several = [i for i, a in enumerate(axes) if count[a.index] > 1 and a.name in kinds[a.index].magnitudes]
    if not several:
        return []
    null = np.array([fit.space.forward(a.param.null, a) if i in several else 0.0 for i, a in enumerate(axes)])
    for i in absent(evidence, fit, several, null):
        if count[axes[i].index] > 1:
            count[axes[i].index] -= 1
            out.append(i)
    return out


def _without(evidence: ContactEvidence, fit: Fit, gone: Sequence[int]) -> World:
    """Return the fit's world with the coordinates `gone` at null, and add them to `evidence.absent`."""
    effects = list(fit.world.effects)
    for a in (fit.space.axes[i] for i in gone):
        effects[a.index] = effects[a.index].with_values(**{a.name: a.param.null})
        evidence.absent = evidence.absent | {(effects[a.index].effect, a.name)}
    return replace(fit.world, effects=tuple(effects))
