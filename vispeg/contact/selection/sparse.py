"""Fit without parameters that may be absent: e.g. a fixture compliant in x alone needs no pitch compliance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.selection.likely import absent
from vispeg.core.effect import effect
from vispeg.core.rules import RULES
from vispeg.identify.fit import Fit
from vispeg.worlds.world import World


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
