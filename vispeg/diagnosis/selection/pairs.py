"""Propose several effects at once in one joint, none of which is visible without the others.

Examples are friction, rotor inertia and bias of a torque-driven wrist, or a slow servo with limited goals. A distant
effect (`Effect.distant`) changes nothing near null, so a fit cannot start there. A fit of two starts at values
estimated from the data for both (`Effect.guesses`), tried in all combinations by rollout. Fits end in different optima,
so several are started, and the held-out recordings choose.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from vispeg.core.effect import Effect, EffectInstance, searchable
from vispeg.diagnosis.evidence.localise import MissingTorque, joint_data, joint_z
from vispeg.diagnosis.evidence.signatures import guessed
from vispeg.diagnosis.findings import Score
from vispeg.diagnosis.selection.searching import Searching
from vispeg.diagnosis.selection.state import State
from vispeg.worlds.model_file import model_text

HOOKS = ("goal", "regulate", "drive")  # methods of an effect in a joint's drive: two effects in one are confounded


def pairs(search: Searching, state: State, missing: Sequence[MissingTorque]) -> list[Score]:
    """Return pairs of distant effects in the joint that misses most torque, best first; stored in the progress.

    The gain of a pair is that at its start values. `missing` is the missing torque of each fitted item.
    """
    evidence, joint = search.evidence, _worst(search, missing)

    def work_out() -> list:
        data, rows = joint_data(missing, evidence.items), []
        before = float(state.residual @ state.residual)
        for kinds in _kinds(search, state, joint):
            first, second = (guessed(kind.name, joint, evidence.items[0], data) for kind in kinds)
            starts = [(a, b) for a in first for b in second]
            squared = [float(r @ r) for r in evidence.each_residual([state.world.add(*start) for start in starts])]
            for k in _best(squared, len(second)):
                rows.append([[_values(e) for e in starts[k]], before - squared[k]])
        return sorted(rows, key=lambda row: -row[1])

    out, question = [], ["pairs", model_text(state.world), joint, evidence.weights]
    for members, gain in search.progress.recall(question, work_out):
        first, second = (EffectInstance.of(name, joint, **values) for name, values in members)
        out.append(Score(first, gain, (second,)))
    return [s for s in out if s.gain > 0]


def _worst(search: Searching, missing: Sequence[MissingTorque]) -> str:
    """Return the joint that misses most torque, in multiples of its noise."""
    return search.evidence.items[0].robot.joints[int(np.argmax(joint_z(missing)))]


def _best(squared: Sequence[float], count: int) -> list[int]:
    """Return the indices of the pairs to fit: for each guess of the first effect its best pair, best first.

    Args:
        squared: squared residuals of all pairs of guesses; those of one guess of the first effect are consecutive.
        count: number of guesses of the second effect.
    """
    best = [min(range(i, i + count), key=squared.__getitem__) for i in range(0, len(squared), max(count, 1))]
    return sorted(best, key=squared.__getitem__)


def _kinds(search: Searching, state: State, joint: str) -> Iterator[tuple[Effect, Effect]]:
    """Yield pairs of distant effects in different stages of a joint's drive, visible and not in the world there."""
    taken = {e.effect for e in state.world.effects if e.where in (joint, "all")}
    distant = [k for k in searchable().values() if k.distant and search.evidence.sees(k) and k.name not in taken]
    for a, b in combinations(distant, 2):
        if _stages(a) and _stages(b) and not _stages(a) & _stages(b):
            yield a, b


def _stages(kind: Effect) -> set[str]:
    """Return the stages of a joint's drive that an effect changes."""
    return {stage for stage in HOOKS if kind.overrides(stage)}


def _values(placed: EffectInstance) -> list:
    """Return an effect without its place as plain JSON data."""
    return [placed.effect, {k: v.value for k, v in placed.params.items()}]
