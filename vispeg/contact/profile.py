"""Screening by profile: each effect at finite sizes and with both signs, all in one batch.

No derivatives: where nothing touches they vanish, though a size that makes it touch would explain everything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.contact.evidence import ContactEvidence
from vispeg.core.effect import REGISTRY, STAGES, Effect, EffectInstance, effect
from vispeg.diagnosis.evidence.screen import Score
from vispeg.worlds.world import World


def looked_for() -> list[Effect]:
    """What a diagnosis of contact chooses from, in the order of its stages."""
    kinds = [e for _, e in sorted(REGISTRY.items()) if e.stage]
    return sorted(kinds, key=lambda e: STAGES.index(e.stage))


def places(evidence: ContactEvidence, world: World) -> list[tuple[str, str]]:
    """Every (effect, place) that is not yet in the world: of an effect with several places the one that rules.

    What a force sensor makes of a wrench is left out where none was read by one.
    """
    scene, read = evidence.items[0].source.scene, any(i.source.torques is None for i in evidence.items)
    out = []
    for kind in looked_for():
        targets = kind.targets(scene)
        where = scene.held if scene.held in targets else (targets or [""])[0]
        if (not read and kind.overrides("wrench")) or not where:
            continue
        if not any(e.effect == kind.name for e in world.effects):
            out.append((kind.name, where))
    return out


def tries(name: str, where: str) -> list[tuple[str, EffectInstance]]:
    """Every parameter of an effect at every size, one parameter at a time."""
    return [(k, EffectInstance.of(name, where, **{k: v})) for k, values in effect(name).sizes.items() for v in values]


@dataclass(frozen=True)
class Probe:
    """One size of one parameter of an effect, and by how much it lowers the squared residual; -inf if nothing moves."""

    placed: EffectInstance
    name: str
    gain: float


def probed(evidence: ContactEvidence, world: World, where: Sequence[tuple[str, str]]) -> list[Probe]:
    """Every size of every parameter of the effects at their places, beside those of `world`."""
    probes = [p for name, at in where for p in tries(name, at)]
    (base,), rows = evidence.residuals([world]), evidence.residuals([world.add(p) for _, p in probes])
    out = []
    for (name, placed), r in zip(probes, rows, strict=True):
        moved = float(np.sum((r - base) ** 2))
        out.append(Probe(placed, name, float(base @ base - r @ r) if moved > FELT**2 else -np.inf))
    return out


def strongest(probes: Sequence[Probe]) -> list[Score]:
    """The best size of each effect, best first; one that nothing excites has the gain -inf."""
    out: dict[tuple[str, str], Score] = {}
    for p in probes:
        score = Score(p.placed, p.gain)
        if score.key not in out or score.gain > out[score.key].gain:
            out[score.key] = score
    return sorted(out.values(), key=lambda s: -s.gain)


def profile(evidence: ContactEvidence, world: World, where: Sequence[tuple[str, str]]) -> list[Score]:
    """The best size of each effect beside those of `world`, by the drop of the squared residual; best first."""
    return strongest(probed(evidence, world, where))


def idle(probes: Sequence[Probe]) -> set[tuple[str, str]]:
    """(effect, parameter) that no size of gains a `SHARE` of what the effect's best parameter does."""
    top: dict[str, float] = {}
    best: dict[tuple[str, str], float] = {}
    for p in probes:
        key = p.placed.effect, p.name
        top[p.placed.effect] = max(top.get(p.placed.effect, -np.inf), p.gain)
        best[key] = max(best.get(key, -np.inf), p.gain)
    return {key for key, gain in best.items() if gain < max(SHARE * top[key[0]], 0.0) and gain < top[key[0]]}


FELT = 5.0  # standard deviations by which some size must move the residual for an effect to be excited
SHARE = 0.03
