"""Effects that a recording determines in combination alone: a heavier tool that a weaker sensor reads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.conclusion.verdict import Verdict
from vispeg.diagnosis.schema import FoundEffect
from vispeg.diagnosis.selection.accept import CORRELATED
from vispeg.identify.fit import Fit

Pair = tuple[EffectInstance, EffectInstance]


def entangled(fit: Fit | None, n_fixed: int) -> list[Pair]:
    """Pairs of added effects that need another motion to be told apart (`Effect.told_from`), and whose estimates are
    correlated.
    """
    if fit is None:
        return []
    out = []
    for i, a in enumerate(fit.world.effects):
        for j, b in enumerate(fit.world.effects[i + 1 :], i + 1):
            alike = b.effect in effect(a.effect).told_from or a.effect in effect(b.effect).told_from
            if i >= n_fixed and alike and _correlation(fit, i, j) > CORRELATED:
                out.append((a, b))
    return out


def judged(verdict: Verdict, pairs: Sequence[Pair]) -> Verdict:
    """`ambiguous` in place of `identified` where some effects are determined in combination alone."""
    if verdict.verdict != "identified" or not pairs:
        return verdict
    named = "; ".join(f"{a.label} and {b.label}" for a, b in pairs)
    return Verdict("ambiguous", f"these recordings determine only a combination of {named}", partial=verdict.partial)


def beside(effects: list[FoundEffect], pairs: Sequence[Pair]) -> list[FoundEffect]:
    """The effects of a record, each with what it is determined in combination with."""
    for a, b in [*pairs, *((b, a) for a, b in pairs)]:
        entry = next(e for e in effects if (e["effect"], e["where"]) == (a.effect, a.where))
        other = {"effect": b.effect, "where": b.where}
        entry["indistinguishable_from"] += [] if other in entry["indistinguishable_from"] else [other]
    return effects


def _correlation(fit: Fit, i: int, j: int) -> float:
    """The greatest, without its sign, of an estimate of one effect with one of the other."""
    rows, columns = ([k for k, a in enumerate(fit.space.axes) if a.index == n] for n in (i, j))
    return float(np.abs(fit.correlation[np.ix_(rows, columns)]).max(initial=0.0))
