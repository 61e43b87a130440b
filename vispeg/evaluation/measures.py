"""Whether a robot takes as long and presses as hard as the simulation: medians on both sides, and a rank test.

After the two sources: on the paper's robot an insertion took longer than in simulation, because it searched longer;
the article holds a peak force that is more than half away from the simulated one to be the contact model's fault.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import mannwhitneyu

from vispeg.evaluation.records import Episode
from vispeg.evaluation.schema.gap import Measure
from vispeg.evaluation.statistics.decide import CANNOT_TELL
from vispeg.evaluation.statistics.significance import ALPHA

APART = 0.5  # of the simulated peak force
UNITS = {"time": "s", "peak_force": "N"}
NAMES = {"time": "successes take", "peak_force": "the peak force is"}


def compare(first: Sequence[Episode], second: Sequence[Episode]) -> list[Measure]:
    """Time of the successes and peak force of all episodes, in the simulation and on the robot.

    Returns:
        [{measure, unit, first, second, n, p, verdict, apart, words}]: medians, finite values a side, Mann-Whitney's
        two-sided p; apart: a peak force beyond doubt and by more than half another one. Without a value on a side the
        measure is left out.
    """
    measures: list[Measure] = []
    for name, unit in UNITS.items():
        sides = [[e for e in side if name != "time" or e.success] for side in (first, second)]
        values = [np.array([getattr(e, name) for e in side], float) for side in sides]
        x, y = (v[np.isfinite(v)] for v in values)
        if not len(x) or not len(y):
            continue
        here, there = float(np.median(x)), float(np.median(y))
        p = float(mannwhitneyu(x, y).pvalue)
        verdict = "different" if p < ALPHA else CANNOT_TELL
        apart = name == "peak_force" and verdict == "different" and abs(there - here) > APART * here
        measures.append(
            {
                "measure": name,
                "unit": unit,
                "first": here,
                "second": there,
                "n": [len(x), len(y)],
                "p": p,
                "verdict": verdict,
                "apart": apart,
                "words": _words(name, here, there, verdict, apart),
            }
        )
    return measures


def _words(name: str, here: float, there: float, verdict: str, apart: bool) -> str:
    unit = UNITS[name]
    if verdict != "different":
        return f"{NAMES[name]} {here:.3g} and {there:.3g} {unit}: whether they differ, {CANNOT_TELL}"
    more = {"time": ("longer", "shorter"), "peak_force": ("higher", "lower")}[name][int(there < here)]
    said = f"{NAMES[name]} {abs(there - here):.3g} {unit} {more}, {there:.3g} instead of {here:.3g}"
    return said + ", more than half apart: look at the contact model" * apart
