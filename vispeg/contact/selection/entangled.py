"""Effects that a recording determines in combination alone: a heavier tool that a weaker sensor reads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.contact.items import ContactItem
from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.conclusion.verdict import Verdict
from vispeg.diagnosis.schema import FoundEffect, Place
from vispeg.diagnosis.selection.accept import CORRELATED
from vispeg.identify.fit import Fit
from vispeg.recordings.checks.extent import TILT

Pair = tuple[EffectInstance, EffectInstance]


def entangled(fit: Fit | None, n_fixed: int, tilted: bool) -> list[Pair]:
    """Pairs of added effects that need another motion to be told apart (`Effect.told_from`), where the tool was not
    `tilted` as that of free air does, or where their estimates are correlated.
    """
    if fit is None:
        return []
    out = []
    for i, a in enumerate(fit.world.effects):
        for j, b in enumerate(fit.world.effects[i + 1 :], i + 1):
            motion = effect(a.effect).told_from.get(b.effect) or effect(b.effect).told_from.get(a.effect)
            unseen = motion == "free" and not tilted
            if i >= n_fixed and motion and (unseen or _correlation(fit, i, j) > CORRELATED):
                out.append((a, b))
    return out


def tilted(items: Sequence[ContactItem]) -> bool:
    """Whether the tool was tilted as far as tells its weight from a sensor's zero and gain."""
    turns = [i.path.place[:, 3:5] for i in items]  # intrinsic x, y, z: the axis leans by what x and y make
    return any(float(np.cos(t).prod(axis=1).min()) <= np.cos(TILT) for t in turns)


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
        other: Place = {"effect": b.effect, "where": b.where}
        entry["indistinguishable_from"] += [] if other in entry["indistinguishable_from"] else [other]
    return effects


def _correlation(fit: Fit, i: int, j: int) -> float:
    """The greatest, without its sign, of an estimate of one effect with one of the other."""
    rows, columns = ([k for k, a in enumerate(fit.space.axes) if a.index == n] for n in (i, j))
    return float(np.abs(fit.correlation[np.ix_(rows, columns)]).max(initial=0.0))
