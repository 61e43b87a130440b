"""Goodness of fit of the final model: its residual in each phase of contact against the noise floor.

A mean square over everything would hide an error in a few blocks, e.g. due to a chip inside the goal. So each phase
of contact is judged separately, in the fitted recordings and in the held-out ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.phases import NAMES
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Verdict, left_unexplained
from vispeg.diagnosis.scale import floors
from vispeg.worlds.world import World

CHANNELS = 6


@dataclass(frozen=True)
class Rest:
    """One phase: mean squared whitened residual, its upper limit for a correct model, and the number of blocks."""

    phase: str
    held_out: bool
    mean_square: float
    bar: float
    blocks: int

    @property
    def beyond(self) -> float:
        """Mean square over its limit."""
        return self.mean_square / self.bar


def remainder(evidence: ContactEvidence, world: World, held_out: bool = False) -> list[Rest]:
    """Return the residual of each phase of contact, worst first; `held_out` says which recordings these are."""
    predicted = evidence.simulated([world])
    residual = evidence.whitened([y[0] for y in predicted])
    out = []
    for name in NAMES:
        masks = [i.phase.of(name) & i.phase.valid & ~i.phase.resting for i in evidence.items]
        parts = [r[m] for r, m in zip(residual, masks, strict=True) if m.any()]
        if parts:
            rows = np.concatenate(parts)
            independent = max(1.0, CHANNELS * len(rows) / evidence.correlated)
            out.append(Rest(name, held_out, float(np.mean(rows**2)), most_left(independent), len(rows)))
    return sorted(out, key=lambda rest: -rest.beyond)


def most_left(independent: float) -> float:
    """Return the mean squared whitened residual up to which chance explains so many independent errors."""
    return 1 + RULES.phase_spread * float(np.sqrt(2 / independent))


def of_phases(verdict: Verdict, rests: Sequence[Rest]) -> Verdict:
    """Change a verdict to `unexplained` if the residual of some phase exceeds its limit."""
    worst = max(rests, key=lambda rest: rest.beyond, default=None)
    if worst is None or worst.beyond <= 1.0 or verdict.verdict == "unexplained":
        return verdict
    where = "held-out" if worst.held_out else "fitted"
    text = (
        f"in {worst.phase} an error of {floors(worst.mean_square)} × the noise floor remains, which neither errors of "
        f"the sensor's zero and the path nor a known effect explain ({worst.blocks} {where} blocks; up to "
        f"{floors(worst.bar)} × may be chance or the contact law's own error)"
    )
    return left_unexplained(text)
