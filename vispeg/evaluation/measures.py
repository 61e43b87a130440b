"""Whether a robot takes as long and presses as hard as the simulation: medians on both sides, and a test of ranks.

After the two sources: on the paper's robot an insertion took longer than in simulation, because it searched longer;
the article holds a peak force that is more than half away from the simulated one to be the contact model's fault.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from vispeg.evaluation.records import Episode
from vispeg.evaluation.schema.gap import Measure
from vispeg.evaluation.statistics import CANNOT_TELL, Decision, by_ranks
from vispeg.evaluation.table import rows

APART = 0.5  # of the simulated peak force
UNITS = {"time": "s", "peak_force": "N"}
NAMES = {"time": "successes take", "peak_force": "the peak force is"}


@dataclass(frozen=True)
class Measured:
    """Medians of a measure on both sides, and the finite values behind them; `p` of `statistics.by_ranks`."""

    name: str
    first: float
    second: float
    n: tuple[int, int]
    p: float | None

    def decided(self, decision: Decision) -> Measure:
        """Give a row with what the page's family decides; `apart`: a peak force that differs, by more than half."""
        apart = self.name == "peak_force" and decision.certain and abs(self.second - self.first) > APART * self.first
        return {
            "measure": self.name,
            "unit": UNITS[self.name],
            "first": self.first,
            "second": self.second,
            "n": list(self.n),
            "p": self.p,
            "verdict": decision.verdict,
            "apart": apart,
            "words": _words(self.name, self.first, self.second, decision.certain, apart),
        }


def compare(first: Sequence[Episode], second: Sequence[Episode]) -> list[Measured]:
    """Compare the time of the successes and the peak force of all episodes, in the simulation and on the robot.

    Without a value on a side a measure is left out.
    """
    measures = []
    for name in UNITS:
        sides = [
            [e for e in side if (name != "time" or e.success) and np.isfinite(getattr(e, name))]
            for side in (first, second)
        ]
        if all(sides):
            x, y = ([getattr(e, name) for e in side] for side in sides)
            p = by_ranks(*(rows(side, lambda e: (e.seed, e.configuration), attrgetter(name)) for side in sides))
            measures.append(Measured(name, float(np.median(x)), float(np.median(y)), (len(x), len(y)), p))
    return measures


def _words(name: str, here: float, there: float, differ: bool, apart: bool) -> str:
    unit = UNITS[name]
    if not differ:
        return f"{NAMES[name]} {here:.3g} and {there:.3g} {unit}: whether they differ, {CANNOT_TELL}"
    if f"{here:.3g}" == f"{there:.3g}":
        return f"{NAMES[name]} {here:.3g} {unit} on both sides in the median, but not alike in all"
    more = {"time": ("longer", "shorter"), "peak_force": ("higher", "lower")}[name][int(there < here)]
    said = f"{NAMES[name]} {abs(there - here):.3g} {unit} {more}, {there:.3g} instead of {here:.3g}"
    return said + ", more than half apart: look at the contact model" * apart
