"""Which recordings judge: those that were asked to, unless nothing that the model lacks shows in them.

A drive that saturates in two of three motions leaves no trace in the third, and no effect can be judged there: then one
of the two judges in its place, and it is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.identify.evidence import Evidence
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World

QUIET = 1.25  # noise variances, up to which a recording shows nothing that a model lacks
LOUD = 10.0  # noise variances, from which on one does


@dataclass(frozen=True)
class Roles:
    """Recordings to fit, those to judge on, what the reader is told of it, and the name of one that none can judge."""

    fitted: list[Recording]
    held_out: list[Recording]
    note: str
    alone: str = ""

    def unjudged(self, world: World, evidence: Evidence) -> Roles | None:
        """These roles, if one recording alone shows what a model lacks, and `world` lacks it still."""
        return self if self.alone and max(shown(evidence, world)) > LOUD else None


def recast(world: World, evidence: Evidence, judged: Evidence) -> Roles | None:
    """Roles of the recordings behind two sets of evidence, where those that they were given cannot be left unsaid.

    Of several fitted recordings that show what the model lacks the last one judges, if none that should judge does. Of
    one alone it is said that nothing else shows it: what is fitted to it is judged nowhere.
    """
    if max(shown(judged, world)) > QUIET:
        return None
    means = shown(evidence, world)
    loud = [r for r, mean in zip(evidence.recordings, means, strict=True) if mean > LOUD]
    if not loud:
        return None
    names = ", ".join(r.name for r in judged.recordings)
    if len(loud) == 1:
        what = f"{loud[0].name} is {max(means):.3g} noise variances from the model, and none of it shows in {names}"
        note = f"{what}: nothing can be judged before another recording shows it"
        return Roles(evidence.recordings, judged.recordings, note, loud[0].name)
    rest = [r for r in evidence.recordings if r is not loud[-1]]
    note = f"nothing that the model lacks shows in {names}, so {loud[-1].name} judges and {names} is fitted"
    return Roles([*rest, *judged.recordings], [loud[-1]], note)


def shown(evidence: Evidence, world: World) -> list[float]:
    """Mean squared whitened residual of each recording under a world; 1 at the noise floor."""
    residual, start = evidence.residuals([world])[0], 0
    total, count = np.zeros((2, len(evidence.recordings)))
    index = {id(r): k for k, r in enumerate(evidence.recordings)}
    for item in evidence.items:
        k = index[id(item.recording)]
        total[k] += np.sum(residual[start : start + item.measured.size] ** 2)
        count[k] += item.valid.sum()
        start += item.measured.size
    return (total / np.maximum(count, 1)).tolist()
