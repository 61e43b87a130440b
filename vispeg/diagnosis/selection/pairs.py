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

from vispeg.core.effect import Effect, EffectInstance, effect, searchable
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.localise import MissingTorque, joint_data, joint_z
from vispeg.diagnosis.evidence.screen import candidates
from vispeg.diagnosis.evidence.signatures import guessed
from vispeg.diagnosis.findings import Score
from vispeg.diagnosis.selection.searching import Searching
from vispeg.diagnosis.selection.state import State
from vispeg.worlds.model_file import model_text

STAGES = ("goal", "regulate", "drive")  # hooks of a joint's drive: two effects in the same hook are confounded


def pairs(search: Searching, state: State, missing: Sequence[MissingTorque]) -> list[Score]:
    """Return pairs of distant effects in the joint that misses most torque, best first; the answer is stored.

    For each guess of the first effect only the best guess of the second is kept, and of pairs with nearly the same
    values only the best. `missing` is the missing torque of each fitted item.
    """
    evidence, joints = search.evidence, search.evidence.items[0].robot.joints
    worst = int(np.argmax(joint_z(missing)))

    def work_out() -> list:
        data, out = joint_data(missing, evidence.items), []
        for kinds in _kinds(search, state, joints[worst]):
            a, b = (guessed(kind.name, joints[worst], evidence.items[0], data) for kind in kinds)
            tried = [(first, second) for first in a for second in b]
            squared = [float(r @ r) for r in evidence.each_residual([state.world.add(*both) for both in tried])]
            best = [min(range(i, i + len(b)), key=squared.__getitem__) for i in range(0, len(tried), max(len(b), 1))]
            apart: list[int] = []
            for k in sorted(best, key=squared.__getitem__):
                apart += [] if any(_alike(tried[k], tried[other]) for other in apart) else [k]
            out += [
                [[_values(e) for e in tried[k]], float(state.residual @ state.residual) - squared[k]] for k in apart
            ]
        return sorted(out, key=lambda row: -row[1])

    rows = search.progress.recall(["pairs", model_text(state.world), joints[worst]], work_out)
    out = []
    for members, gain in rows:
        first, second = (EffectInstance.of(name, joints[worst], **values) for name, values in members)
        out.append(Score(first, gain, (second,)))
    return [s for s in out if s.gain > 0]


def all_common(search: Searching, state: State, missing: Sequence[MissingTorque]) -> list[Score]:
    """Return as one group the effects that every arm has and the world lacks in the joint that misses most torque.

    Empty if there is only one.
    """
    joints = search.evidence.items[0].robot.joints
    worst = joints[int(np.argmax(joint_z(missing)))]
    places = [(name, where) for name, where in candidates(search.evidence, state.world, [worst]) if where == worst]
    group = [(name, where) for name, where in places if effect(name).common]
    return search.screened(state.world, state.residual, state.fit, [], missing, [group]) if len(group) > 1 else []


def _kinds(search: Searching, state: State, joint: str) -> Iterator[tuple[Effect, Effect]]:
    """Yield pairs of distant effects in different stages of a joint's drive, visible and not in the world there."""
    taken = {e.effect for e in state.world.effects if e.where in (joint, "all")}
    far = [k for k in searchable().values() if k.distant and search.evidence.sees(k) and k.name not in taken]
    for a, b in combinations(far, 2):
        if _stages(a) and _stages(b) and not _stages(a) & _stages(b):
            yield a, b


def _stages(kind: Effect) -> set[str]:
    return {stage for stage in STAGES if kind.overrides(stage)}


def _alike(a: Sequence[EffectInstance], b: Sequence[EffectInstance]) -> bool:
    """Return whether two starts are so close that their fits end at the same optimum."""
    both = [(v.value, y.params[name].value) for x, y in zip(a, b, strict=True) for name, v in x.params.items()]
    return all(abs(v - w) <= RULES.same_start * max(abs(v), abs(w)) for v, w in both)


def _values(placed: EffectInstance) -> list:
    return [placed.effect, {k: v.value for k, v in placed.params.items()}]
