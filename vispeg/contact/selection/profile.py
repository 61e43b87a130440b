"""Screen by profile: each effect at finite sizes and with both signs, all in one batch.

Derivatives are not used: they vanish where nothing touches, though a size that makes contact might explain
everything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

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
    scene, read = evidence.items[0].source.scene, any(i.source.torques is None for i in evidence.items)
    out = []
    for kind in looked_for():
        where = place_of(kind, scene)
        if (not read and kind.overrides("wrench")) or not where or kind.stage == BLOWS:
            continue
        if not any(e.effect == kind.name for e in world.effects):
            out.append((kind.name, where))
    return out


def tries(name: str, where: str) -> list[tuple[str, EffectInstance]]:
    """Return (parameter, effect with it at one of its trial sizes) for every parameter and size of an effect."""
    return [(k, EffectInstance.of(name, where, **{k: v})) for k, values in effect(name).sizes.items() for v in values]


def probed(
    evidence: ContactEvidence,
    world: World,
    where: Sequence[tuple[str, str]],
    least: float = 0.0,
    free: Sequence[int] = (),
) -> list[Probe]:
    """Return probes of every parameter of the effects at their places, added to `world`.

    The sizes of each sign are tried outward from null, on a part of the recordings. They end once a size changed the
    residual and linear extrapolation promises no gain. An effect with a threshold goes on, because extrapolation does
    not hold for it. Sizes of effects that may gain `least` are then evaluated on all of the recordings.

    Args:
        evidence: the fitted recordings.
        world: the world to which each size is added.
        where: (effect, place) of the effects.
        least: drop of the squared residual that is of interest.
        free: indices of effects of the world that are refitted with each size, to first order.
    """
    ways = [way for name, at in where for way in outward(name, at)]
    screen = Screen(evidence, world, free)
    rough: list[Probe] = []
    promise: dict[tuple[str, str], float] = {}
    for step in range(max((len(w) for w in ways), default=0)):
        ways = [w for w in ways if len(w) > step]
        tried, promised = screen.ask([w[step] for w in ways])
        rough += tried
        for t, p in zip(tried, promised, strict=True):
            promise[t.key] = max(p, promise.get(t.key, 0.0))
        bar = max(RULES.size_hope * least, RULES.size_faint * max(promised, default=0.0))
        ways = [
            w
            for w, t, p in zip(ways, tried, promised, strict=True)
            if t.moved <= max(least, RULES.felt**2)
            or (p >= bar and p > t.gain + RULES.size_close * abs(p))
            or _goes_on(t)
        ]
    if screen.part == 1:
        return rough
    hopeful = {
        s.key: s.gain for s in strongest(rough) if s.gain > -np.inf and promise[s.key] > RULES.size_promise * least
    }
    again = [k for k, p in enumerate(rough) if p.key in hopeful and _hopeful(p.gain, hopeful[p.key])]
    if not again:
        return rough
    asked = screen.ask([(rough[k].name, rough[k].placed) for k in again], in_part=False)[0]
    exact = dict(zip(again, asked, strict=True))
    best = {s.key: s.gain for s in strongest(list(exact.values()))}
    return [exact.get(k, _beside(p, hopeful, best)) for k, p in enumerate(rough)]


def _beside(p: Probe, hopeful: dict[tuple[str, str], float], best: dict[tuple[str, str], float]) -> Probe:
    """Return a probe on a part of the recordings with its gain scaled to be comparable with those on all of them.

    The scaled gain has the same ratio to the effect's best gain on all recordings as the raw gain has to its best gain
    on the part. Raw gains are not comparable: a part that begins in contact is many times as sensitive to a wrong
    height.
    """
    if p.key not in best or p.gain <= 0 or hopeful[p.key] <= 0:
        return p
    return replace(p, gain=p.gain / hopeful[p.key] * max(best[p.key], 0.0))


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


def _goes_on(t: Probe) -> bool:
    """Return whether a larger size of an effect with a threshold (e.g. of a grip) may gain more."""
    return effect(t.placed.effect).remembers and t.gain > 0


def _hopeful(gain: float, best: float) -> bool:
    """Return whether a size may be the best one of its effect."""
    return gain >= (RULES.size_hope * best if best > 0 else best)


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
    """Return the (effect, parameter) pairs that at no size gain a `size_share` of the effect's best parameter."""
    top: dict[str, float] = {}
    best: dict[tuple[str, str], float] = {}
    for p in probes:
        key = p.placed.effect, p.name
        top[p.placed.effect] = max(top.get(p.placed.effect, -np.inf), p.gain)
        best[key] = max(best.get(key, -np.inf), p.gain)
    return {key for key, gain in best.items() if gain < max(RULES.size_share * top[key[0]], 0.0) and gain < top[key[0]]}
