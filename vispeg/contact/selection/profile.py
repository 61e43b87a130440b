"""Screen by profile: each effect at finite sizes and with both signs, all in one batch.

Derivatives are not used: they vanish where nothing touches, though a size that makes contact might explain
everything.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.selection.screen import Probe, Screen
from vispeg.core.effect import REGISTRY, STAGES, Effect, EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Score
from vispeg.robots.scene import Scene
from vispeg.worlds.places import ALL
from vispeg.worlds.world import World

BLOWS = "impact"  # the stage of effects found from impacts


def looked_for() -> list[Effect]:
    """Return the candidate effects of a contact diagnosis, in the order of its stages."""
    kinds = [e for _, e in sorted(REGISTRY.items()) if e.stage]
    return sorted(kinds, key=lambda e: STAGES.index(e.stage))


def place_of(kind: Effect, scene: Scene) -> str:
    """Return the place at which an effect is sought: all, the held part, or its first place; "" if it has none."""
    targets = kind.targets(scene)
    if not targets:
        return ""
    if kind.shared:
        return ALL
    return scene.held if scene.held in targets else targets[0]


def places(evidence: ContactEvidence, world: World) -> list[tuple[str, str]]:
    """Return every (effect, place) that is not yet in the world, except those that only impacts show.

    For impacts see `vispeg.contact.again.damping`. Effects of a force sensor are left out if none measured the
    wrench.
    """
    scene = evidence.items[0].source.scene
    wrench_measured = any(i.source.torques is None for i in evidence.items)  # else it is estimated from joint torques
    out = []
    for kind in looked_for():
        where = place_of(kind, scene)
        if (not wrench_measured and kind.overrides("wrench")) or not where or kind.stage == BLOWS:
            continue
        if not any(e.effect == kind.name for e in world.effects):
            out.append((kind.name, where))
    return out


def tries(name: str, where: str) -> list[tuple[str, EffectInstance]]:
    """Return (parameter, effect with it at one of its trial sizes) for every parameter and size of an effect."""
    return [(k, EffectInstance.of(name, where, **{k: v})) for k, values in effect(name).sizes.items() for v in values]


def probed(screen: Screen, where: Sequence[tuple[str, str]], least: float) -> list[Probe]:
    """Return probes of every parameter of the effects at their places.

    The sizes of each sign are tried outward from null. The next size is tried if this one changes the residual by at
    most `least` (squared norm), or may gain more when larger (`_goes_on`).
    """
    ways = [way for name, at in where for way in outward(name, at)]
    out: list[Probe] = []
    for step in range(max((len(w) for w in ways), default=0)):
        ways = [w for w in ways if len(w) > step]
        tried = screen.ask([w[step] for w in ways])
        out += tried
        ways = [w for w, t in zip(ways, tried, strict=True) if t.moved <= least or _goes_on(t, RULES.promise * least)]
    return out


def outward(name: str, where: str) -> list[list[tuple[str, EffectInstance]]]:
    """Return the sizes of each parameter of an effect by sign, the nearest to null first."""
    ways: dict[tuple[str, bool], list[tuple[float, EffectInstance]]] = {}
    for k, placed in tries(name, where):
        size = size_of(name, k, placed)
        ways.setdefault((k, size > 0), []).append((abs(size), placed))
    return [[(k, placed) for _, placed in sorted(way, key=lambda s: s[0])] for (k, _), way in ways.items()]


def size_of(name: str, parameter: str, placed: EffectInstance) -> float:
    """Return the distance of a value from null; for a scale its logarithm."""
    param, value = effect(name).params[parameter], placed.params[parameter].value
    return float(np.log(value / param.null)) if param.scale == "log" else value - param.null


def _goes_on(t: Probe, least: float) -> bool:
    """Return whether a larger size may gain more.

    By linear extrapolation the best size is a larger one if `gain > moved`, and must promise a gain of `least`. Of an
    effect with a threshold (a grip that slips) any gain suffices, because extrapolation does not hold for it.
    """
    beyond = t.gain > t.moved and t.promise >= least
    return beyond or (effect(t.placed.effect).remembers and t.gain > 0)


def strongest(probes: Sequence[Probe]) -> list[Score]:
    """Return the best size of each effect, best first; an effect that nothing excites has the gain -inf."""
    out: dict[tuple[str, str], Score] = {}
    for p in probes:
        score = Score(p.placed, p.gain)
        if score.key not in out or score.gain > out[score.key].gain:
            out[score.key] = score
    return sorted(out.values(), key=lambda s: -s.gain)


def promises(probes: Sequence[Probe]) -> dict[tuple[str, str], float]:
    """Return for each (effect, place) the gain promised by its best size; a fit finds sizes between the tried ones."""
    out: dict[tuple[str, str], float] = {}
    for p in probes:
        out[p.key] = max(p.promise, out.get(p.key, -np.inf))
    return out


def idle(probes: Sequence[Probe]) -> set[tuple[str, str]]:
    """Return the (effect, parameter) pairs that gain almost nothing at any size.

    That is less than a share `RULES.contact_alike` of the gain of the effect's best parameter. If the best parameter
    raises the residual, all others are idle.
    """
    top: dict[str, float] = {}
    best: dict[tuple[str, str], float] = {}
    for p in probes:
        key = p.placed.effect, p.name
        top[p.placed.effect] = max(top.get(p.placed.effect, -np.inf), p.gain)
        best[key] = max(best.get(key, -np.inf), p.gain)
    least = {name: RULES.contact_alike * gain if gain > 0 else gain for name, gain in top.items()}
    return {(name, k) for (name, k), gain in best.items() if gain < least[name]}
