"""Compare time and peak force on a robot with those in simulation: medians on both sides, and a rank test.

The two sources (docs/sources.md) give the reasons. On the paper's robot an insertion took longer than in simulation,
because it searched longer. The article blames the contact model if the peak force differs from the simulated one by
more than half.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from vispeg.evaluation.records import Episode
from vispeg.evaluation.schema.gap import Measure
from vispeg.evaluation.statistics import CANNOT_TELL, Decision, by_ranks
from vispeg.evaluation.table import rows

DECIMALS = 6  # us and uN: the rounding of a clock's readings must not break ties between equal times
APART = 0.5  # largest difference of the peak force, as a share of the simulated one
UNITS = {"time": "s", "peak_force": "N"}
NAMES = {"time": "successes take", "peak_force": "the peak force is"}


@dataclass(frozen=True)
class Measured:
    """A measure on both sides.

    Attributes:
        name: `time` (s) or `peak_force` (N).
        first, second: medians.
        n: number of values on each side.
        p: p-value of `statistics.by_ranks`; None where no test can be made.
    """

    name: str
    first: float
    second: float
    n: tuple[int, int]
    p: float | None

    def decided(self, decision: Decision) -> Measure:
        """Return a row with the page's decision; `apart` marks a peak force found to differ, by more than half."""
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
    """Compare time of successes and peak force of all episodes, in simulation (`first`) and on the robot (`second`).

    A measure without a value on one of the sides is left out.
    """
    measures = []
    for name in UNITS:
        sides = [
            [e for e in side if (name != "time" or e.success) and np.isfinite(getattr(e, name))]
            for side in (first, second)
        ]
        if all(sides):
            value = partial(_value, name=name)
            x, y = ([value(e) for e in side] for side in sides)
            p = by_ranks(*(rows(side, lambda e: (e.seed, e.configuration), value) for side in sides))
            measures.append(Measured(name, float(np.median(x)), float(np.median(y)), (len(x), len(y)), p))
    return measures


def _value(episode: Episode, name: str) -> float:
    return round(float(getattr(episode, name)), DECIMALS)


def _words(name: str, here: float, there: float, differ: bool, apart: bool) -> str:
    unit = UNITS[name]
    if not differ:
        return f"{NAMES[name]} {here:.3g} and {there:.3g} {unit}: whether they differ, {CANNOT_TELL}"
    if f"{here:.3g}" == f"{there:.3g}":
        return f"{NAMES[name]} {here:.3g} {unit} on both sides in the median, but their distributions differ"
    more = {"time": ("longer", "shorter"), "peak_force": ("higher", "lower")}[name][int(there < here)]
    said = f"{NAMES[name]} {abs(there - here):.3g} {unit} {more}, {there:.3g} instead of {here:.3g}"
    return f"{said}, more than half apart: look at the contact model" if apart else said
