"""How far a policy's success falls from one world to another over the configurations of a suite, with its interval.

The mean over configurations of the difference in success. Where both worlds were played on the same seeds, it is a
contrast of the episodes: one number a network and seed, the mean over configurations, so that a seed that is hard in
every configuration counts once (see `crossed`). Where they were not, as with a robot's trials, Newcombe's
intervals of the configurations are put together by the squares of their distances (G. Y. Zou, A. Donner, Statistics in
Medicine 27 (2008) 1693); of several networks by the distances themselves, as what a network is, it is in all
configurations.

A fall is beyond doubt where its whole 95 % interval lies above 5 points, the margin within which two success rates are
called equal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vispeg.evaluation.records import Episode
from vispeg.evaluation.statistics.crossed import Block, contrast, rate
from vispeg.evaluation.statistics.decide import MARGIN
from vispeg.evaluation.statistics.intervals import Estimate
from vispeg.evaluation.table import Cell, Table

Sides = Sequence[tuple[Sequence[Episode], Sequence[Episode]]]  # a configuration: episodes in the one world, the other


def fall(sides: Sides) -> Estimate:
    """Success in the first world less success in the second, over the configurations of one policy."""
    paired = _paired(sides)
    if paired is not None:
        return contrast([Block(paired.mean(axis=0))], pairs=paired.shape[0] * paired.shape[2])
    ends, networks = [], 1
    for both in sides:
        tables = [Table(side) for side in both]
        y = [t.outcomes(Cell(t.policies[0], t.worlds[0])) for t in tables]
        a, b = (rate(outcomes) for outcomes in y)
        networks = max(networks, *map(len, y))
        below, above = (
            math.hypot(*d) for d in ((a.value - a.low, b.high - b.value), (a.high - a.value, b.value - b.low))
        )
        ends.append((a.value - b.value, below, above, min(a.n, b.n)))
    value, below, above = float(np.mean([e[0] for e in ends])), *np.array(ends)[:, 1:3].T
    reach = [float(d.mean() if networks > 1 else math.sqrt(np.sum(d**2)) / len(d)) for d in (below, above)]
    return Estimate(value, max(-1.0, value - reach[0]), min(1.0, value + reach[1]), sum(int(e[3]) for e in ends))


def beyond_doubt(estimate: Estimate) -> bool:
    """Whether the whole interval lies above the margin."""
    return estimate.low > MARGIN


def _paired(sides: Sides) -> np.ndarray | None:
    """Differences (configurations, networks, seeds) where all share networks and two seeds or more, else None."""
    if any(not e.world_hash for both in sides for side in both for e in side):
        return None  # measured: a trial's number is no start
    rows = [[{(e.train_seed, e.seed): e.success for e in side} for side in both] for both in sides]
    shared = set.intersection(*(set(side) for both in rows for side in both))
    networks = sorted({t for both in rows for side in both for t, _ in side})
    seeds = sorted(s for s in {s for _, s in shared} if all((t, s) in shared for t in networks))
    if len(seeds) < 2:
        return None
    return np.array([[[float(a[t, s]) - float(b[t, s]) for s in seeds] for t in networks] for a, b in rows])
