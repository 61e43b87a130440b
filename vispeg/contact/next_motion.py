"""The next motion to record: one that distinguishes effects or excites new ones, repeated differently if need be."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import combinations

from vispeg.core.effect import EffectInstance, effect, told_apart_by
from vispeg.diagnosis.findings import Rivals
from vispeg.diagnosis.schema import NextMotion, NotExcited
from vispeg.worlds.world import World

OTHERWISE = {  # how to repeat a motion so that it is more informative
    "free": "with the tool tilted farther, with and without the held part",
    "press": "with more force, at other places",
    "hard-press": "with more force",
    "slide": "with more force, over longer strokes",
    "insert": "with more force against the walls",
    "insert-turned": "with the flange turned the other way",
    "rock": "with the part tilted farther",
    "tap": "at other speeds",
    "touch-datum": "with more force, at other places",
}
ELSE = "in another posture, with more force"


def separating(
    world: World,
    rivals: Sequence[Rivals],
    unseen: Sequence[NotExcited],
    together: Sequence[tuple[EffectInstance, ...]] = (),
    recorded: Collection[str] = (),
) -> NextMotion | None:
    """Return the motion to record next, and why; None if nothing is left to show.

    It distinguishes effects that are determined `together` only, or a world's effect from its competitor; if there are
    none, it excites most of what was not excited. It is the first such motion that is not in `recorded`, or else the
    first one, with a change that makes it more informative.
    """
    for asked in (list(_apart(world, rivals, together)), list(_shows(unseen))):
        new = [(motion, why) for motion, why in asked if motion not in recorded]
        if new:
            motion, why = new[0]
            return {"motion": motion, "why": why}
        if asked:
            motion, why = asked[0]
            again = f"{motion} again, {OTHERWISE.get(motion, ELSE)}"
            return {"motion": again, "why": f"{why}, which {motion} as it was recorded does not"}
    return None


def _apart(
    world: World, rivals: Sequence[Rivals], together: Sequence[tuple[EffectInstance, ...]]
) -> Iterator[tuple[str, str]]:
    """Yield motions that distinguish effects, and why; jointly determined effects first."""
    for entangled in together:
        for a, b in combinations(entangled, 2):
            for motion in apart(a, b.effect):
                yield motion, f"tells {a.label} from {b.label}"
    for r in rivals:
        chosen = next(e for e in world.effects if e.label == r.label)
        for t in r.equals:
            for motion in apart(chosen, t.score.placed.effect):
                yield motion, f"tells {r.label} from {t.score.label}"


def _shows(unseen: Sequence[NotExcited]) -> Iterator[tuple[str, str]]:
    """Yield the motions that would excite what was not excited, the one for most effects first, and what they show."""
    motions = [u["motion"] for u in unseen]
    for motion in sorted(dict.fromkeys(motions), key=motions.count, reverse=True):
        yield motion, f"shows {', '.join(u['effect'] for u in unseen if u['motion'] == motion)}"


def apart(chosen: EffectInstance, other: str) -> list[str]:
    """Return the motions that distinguish two effects, the one for the largest parameter first; empty if none does.

    Effects declare them: `told_from` by the other effect, `told_by` by the largest parameter (see `Effect`).
    """
    kind, by_kind = effect(chosen.effect), told_apart_by(chosen.effect, other)
    if not by_kind:  # `told_by` only refines `told_from`
        return []
    sizes = {k: abs(kind.params[k].start - kind.params[k].null) or 1.0 for k in chosen.params}
    away = {k: abs(v.value - kind.params[k].null) / sizes[k] for k, v in chosen.params.items()}
    largest = max(away, key=lambda k: away[k])
    by_size = kind.told_by.get(largest)
    return list(dict.fromkeys(m for m in (by_size, *by_kind) if m))
