"""Policies against each other in one world, on the same episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.evaluation.statistics.crossed import difference
from vispeg.evaluation.statistics.decide import CANNOT_TELL, Verdict, decide, needed
from vispeg.evaluation.statistics.intervals import Estimate
from vispeg.evaluation.statistics.significance import holm, mcnemar
from vispeg.evaluation.table import Cell, Table


@dataclass(frozen=True)
class Comparison:
    """Two policies in one world.

    Attributes:
        difference: success of `first` minus that of `second`, over training seeds where there are several.
        p: McNemar's exact p-value between these very networks (first training seed against first, and so on).
        p_holm: p after Holm's correction over all comparisons of the world.
        verdict: see `vispeg.evaluation.statistics.decide`.
        needed: paired episodes that could tell, where these cannot.
    """

    world: str
    first: str
    second: str
    difference: Estimate
    p: float
    p_holm: float
    verdict: Verdict
    needed: int | None


def compare(table: Table, world: str, policies: Sequence[str]) -> list[Comparison]:
    """All pairs of policies that have episodes in `world` and share seeds.

    The interval says what the recipes do, over training seeds; McNemar's test what these networks do. A difference is
    called one only where both say so.
    """
    rows = []
    for i, a in enumerate(policies):
        for b in policies[i + 1 :]:
            cells = [Cell(a, world), Cell(b, world)]
            seeds = table.seeds(cells) if table.has(*cells) else []
            if not seeds:
                continue
            ya, yb = table.outcomes(cells[0], seeds), table.outcomes(cells[1], seeds)
            k = min(len(ya), len(yb))
            discordant = float(np.mean(ya[:k] != yb[:k]))
            rows.append((a, b, difference(ya, yb, False), mcnemar(ya[:k], yb[:k]).p, discordant))
    comparisons = []
    for (a, b, d, p, discordant), adjusted in zip(rows, holm([row[3] for row in rows]), strict=True):
        verdict = decide(d, adjusted)
        more = needed(discordant) if verdict == CANNOT_TELL else None
        comparisons.append(Comparison(world, a, b, d, p, adjusted, verdict, more))
    return comparisons
