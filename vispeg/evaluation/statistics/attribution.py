"""Which factor of a change of worlds costs what.

With success s in the reference world, s_f in the world that changes factor f alone, and s_joint in the one that
changes all:

main effect of f = s - s_f total = s - s_joint remainder = total - sum of main effects

The remainder is the factors' interaction: above 0, together they cost more than one by one. All are means of per-
episode contrasts on the same seeds, so that hard episodes and lucky networks cancel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.errors import UserError
from vispeg.evaluation.statistics.crossed import Block, contrast, crossed_bootstrap
from vispeg.evaluation.statistics.intervals import Estimate
from vispeg.evaluation.table import Table


@dataclass(frozen=True)
class Attribution:
    """One policy's total gap, split.

    Attributes:
        total: reference minus joint.
        factors: factor -> reference minus the world that changes it alone.
        remainder: the interaction.
        bootstrap: the same names (`total`, each factor, `remainder`) with bootstrap intervals over training seeds and
            episodes.
    """

    policy: str
    total: Estimate
    factors: dict[str, Estimate]
    remainder: Estimate
    bootstrap: dict[str, Estimate]

    def share(self, factor: str) -> float | None:
        """The factor's part of the total; None where the total may be 0."""
        return self.factors[factor].value / self.total.value if self.total.excludes(0.0) else None


def joint_of(worlds: Sequence[str], reference: str) -> tuple[str | None, list[str]]:
    """The world named by joining others' names (`VNP`), the one of most factors, and its factors (`V`, `N`, `P`)."""
    others = [w for w in worlds if w != reference]
    best: tuple[str | None, list[str]] = (None, [])
    for joint in others:
        factors, rest = [], joint
        while rest:
            parts = sorted((w for w in others if w != joint and rest.startswith(w)), key=len)
            if not parts:
                break
            factors.append(parts[-1])
            rest = rest[len(parts[-1]) :]
        if not rest and len(factors) == len(set(factors)) and len(factors) > max(1, len(best[1])):
            best = (joint, factors)
    return best


def attribute(
    table: Table, policy: str, reference: str, factors: Sequence[str], joint: str, rng: np.random.Generator
) -> Attribution:
    """Splits a policy's gap.

    Raises:
        UserError: fewer than two factors, or worlds without shared episodes.
    """
    if len(factors) < 2:
        raise UserError("nothing to attribute to", expected="two factors or more", got=", ".join(factors))
    y = table.aligned(policy, [reference, *factors, joint])
    parts: dict[str, np.ndarray] = {"total": y[reference] - y[joint]}
    parts |= {f: y[reference] - y[f] for f in factors}
    parts["remainder"] = parts["total"] - np.sum([parts[f] for f in factors], axis=0)
    estimates, boot = {}, {}
    for name, values in parts.items():
        limit = 1.0 + len(factors) if name == "remainder" else 1.0
        estimates[name] = contrast([Block(values)], limit)
        boot[name] = crossed_bootstrap(lambda b: float(b[0].mean()), [values], rng, 1000)
    return Attribution(policy, estimates["total"], {f: estimates[f] for f in factors}, estimates["remainder"], boot)
