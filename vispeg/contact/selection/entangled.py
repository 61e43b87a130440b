"""Practical non-identifiability: effects determined only in combination, such as a heavier tool and a weaker sensor.

The information matrix of a fit, scaled to a diagonal of ones, shows it: along an eigenvector whose eigenvalue is near 0
the parameters may move together while the residual stays. For two parameters, this eigenvalue is one minus the absolute
value of their correlation. Source: Belsley, Kuh and Welsch 1980, Regression Diagnostics, chapter 3.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Verdict
from vispeg.diagnosis.schema import FoundEffect, Place
from vispeg.identify.fit import Fit

Together = tuple[EffectInstance, ...]
FLAT = 1e-12  # smallest norm of a column, against division by 0


def entangled(fit: Fit | None, n_fixed: int) -> list[Together]:
    """Return the sets of added effects that a fit determines only in combination, the least determined first."""
    if fit is None or not len(fit.u):
        return []
    columns = fit.jacobian / np.maximum(np.linalg.norm(fit.jacobian, axis=0), FLAT)
    value, vector = np.linalg.eigh(columns.T @ columns)
    out: list[Together] = []
    for way in vector.T[value < 1 - RULES.correlated]:
        indices = sorted({fit.space.axes[i].index for i in np.flatnonzero(np.abs(way) > RULES.combined_part)})
        together = tuple(fit.world.effects[i] for i in indices)
        if len(indices) > 1 and indices[0] >= n_fixed and together not in out:
            out.append(together)
    return out


def judged(verdict: Verdict, sets: Sequence[Together]) -> Verdict:
    """Change `identified` to `ambiguous` if some effects are determined only in combination."""
    if verdict.verdict != "identified" or not sets:
        return verdict
    named = "; ".join(" and ".join(e.label for e in together) for together in sets)
    return Verdict("ambiguous", f"these recordings determine only a combination of {named}", partial=verdict.partial)


def beside(effects: list[FoundEffect], sets: Sequence[Together]) -> list[FoundEffect]:
    """Add to each effect of a record those with which only a combination is determined; return the effects."""
    for together in sets:
        for a in together:
            entry = next(e for e in effects if (e["effect"], e["where"]) == (a.effect, a.where))
            others: list[Place] = [{"effect": b.effect, "where": b.where} for b in together if b is not a]
            entry["indistinguishable_from"] += [o for o in others if o not in entry["indistinguishable_from"]]
    return effects
