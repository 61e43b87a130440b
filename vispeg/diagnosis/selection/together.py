"""Propose several linear effects at a time, from the linear model alone; one fit of all of them then decides.

Forward step: add the effect that lowers the linear model's cross-validated error most. Among those within `tie` of it,
the one with the fewest parameters is taken; but an effect that the best effect declares likelier than itself is taken
unless the best is clearly better. After each addition, every effect, including those accepted earlier, is exchanged if
another fits better in its place, so that an early wrong guess does not stay, and effects that contribute nearly nothing
are removed.

In the functions, effects are indices of a dictionary's entries: `fixed` are the fitted effects that are not linear and
stay, `chosen` the linear ones so far, `error` their cross-validated squared residual.

Source of the forward step: Chen, Billings and Luo, International Journal of Control 50(5), 1989.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.dictionary import Dictionary
from vispeg.diagnosis.findings import Score


def together(dictionary: Dictionary, most: int) -> Score | None:
    """Return as one candidate the linear effects to add, and the fitted ones that they replace.

    The model then has at most `most` effects. None if there is nothing to add, or if only one effect would change, as
    that is a candidate of its own.
    """
    fixed = [k for k in dictionary.fitted if not dictionary.entries[k].straight]
    before = [k for k in dictionary.fitted if k not in fixed]
    chosen = list(before)
    error = dictionary.crossed([*fixed, *chosen])
    while len(fixed) + len(chosen) < most:
        candidate = _best(dictionary, fixed, chosen, error)
        if candidate is None:
            break
        chosen.append(candidate[1])
        error = _exchanged(dictionary, fixed, chosen, error - candidate[0])
        error = _lighter(dictionary, fixed, chosen, error)
    return _score(dictionary, fixed, before, chosen)


def exchanged(dictionary: Dictionary) -> Score | None:
    """Return as one candidate the best exchange of fitted linear effects, each for another; None if none is better."""
    fixed = [k for k in dictionary.fitted if not dictionary.entries[k].straight]
    before = [k for k in dictionary.fitted if k not in fixed]
    chosen = list(before)
    _exchanged(dictionary, fixed, chosen, dictionary.crossed([*fixed, *chosen]))
    return _score(dictionary, fixed, before, chosen)


def _score(dictionary: Dictionary, fixed: list[int], before: list[int], chosen: list[int]) -> Score | None:
    """Return the candidate that has `chosen` in the place of `before`; None if it adds none or changes only one."""
    new, gone = [k for k in chosen if k not in before], [k for k in before if k not in chosen]
    if not new or len(new) + len(gone) < 2:
        return None
    members = dictionary.placed([*fixed, *chosen])
    out = tuple(dictionary.entries[k].placed for k in gone)
    gain = dictionary.loss([*fixed, *before])[0] - dictionary.loss([*fixed, *chosen])[0]  # as for one effect
    return Score(members[0], gain, tuple(members[1:]), out)


def _best(dictionary: Dictionary, fixed: list[int], chosen: list[int], error: float) -> tuple[float, int] | None:
    """Return (gain, entry) of the best linear effect to add to the chosen ones; None if none promises enough.

    The gain is the drop of the cross-validated error.
    """
    gains = dictionary.gains([*fixed, *chosen])
    gains[[k for k, e in enumerate(dictionary.entries) if not e.straight]] = 0.0
    candidates = []
    for k in (int(k) for k in np.argsort(-gains)[: RULES.looked] if gains[k] > 0):
        coefficients = dictionary.loss([*fixed, *chosen, k])[1]
        signature = dictionary.entries[k].signature
        if signature is None or signature.possible(coefficients[-len(dictionary.entries[k].columns) :].tolist()):
            candidates.append((error - dictionary.crossed([*fixed, *chosen, k]), k))
    # a gain in sample may be a loss in the fold left out
    candidates = [f for f in candidates if f[0] >= _least(dictionary, f[1]) * error]
    if not candidates:
        return None
    top = max(candidates)[0]
    equal = [f for f in candidates if f[0] >= (1 - RULES.tie) * top]
    best = min(equal, key=lambda f: (dictionary.entries[f[1]].size, -f[0]))
    placed = [e.placed for e in dictionary.entries]
    common = [f for f in candidates if f[0] >= prior(placed[f[1]], placed[best[1]]) * best[0]]
    return max(common, default=best)


def _least(dictionary: Dictionary, k: int) -> float:
    """Return the share of the error that the entry `k` must remove: more for masses and centres of links, payloads."""
    placed = dictionary.entries[k].placed
    link = effect(placed.effect).family == "body" and placed.where != "base"
    return RULES.several_link if link else RULES.gain


def prior(a: EffectInstance, b: EffectInstance) -> float:
    """Return the share of the gain of `b` from which `a` is preferred to it; infinite if it never is.

    Link inertias by the manufacturer are reliable, the load is not.
    """
    return RULES.several_likelier if a.effect in effect(b.effect).likelier else np.inf


def _exchanged(dictionary: Dictionary, fixed: list[int], chosen: list[int], error: float) -> float:
    """Exchange chosen effects for better ones until none is, modifying `chosen`; return the remaining error."""
    moved = True
    while moved:
        moved = False
        for k in list(chosen):
            others = [c for c in chosen if c != k]
            without = dictionary.crossed([*fixed, *others])
            candidate = _best(dictionary, fixed, others, without)
            if candidate is None or dictionary.entries[candidate[1]].key == dictionary.entries[k].key:
                continue
            other = dictionary.entries[candidate[1]].placed
            worth = candidate[0] * min(1.0, prior(dictionary.entries[k].placed, other))
            if without - candidate[0] < RULES.several_better * error and worth > without - error:
                chosen[chosen.index(k)], error, moved = candidate[1], without - candidate[0], True
    return error


def _lighter(dictionary: Dictionary, fixed: list[int], chosen: list[int], error: float) -> float:
    """Remove effects from `chosen` that contribute less than half of the required gain; return the remaining error.

    At least one stays.
    """
    for k in list(chosen):
        others = [c for c in chosen if c != k]
        without = dictionary.crossed([*fixed, *others])
        if others and without < (1 + RULES.gain / 2) * error:
            chosen.remove(k)
            error = without
    return error
