"""Screening by profile: each effect at finite sizes and with both signs, all in one batch.

No derivatives: where nothing touches they vanish, though a size that makes it touch would explain everything.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.contact.evidence import ContactEvidence
from vispeg.core.effect import REGISTRY, STAGES, Effect, EffectInstance, effect
from vispeg.diagnosis.screen import Score
from vispeg.worlds.world import World


def looked_for() -> list[Effect]:
    """What a diagnosis of contact chooses from, in the order of its stages."""
    kinds = [e for _, e in sorted(REGISTRY.items()) if e.stage]
    return sorted(kinds, key=lambda e: STAGES.index(e.stage))


def places(evidence: ContactEvidence, world: World) -> list[tuple[str, str]]:
    """Every (effect, place) that is not yet in the world: of an effect with several places the one that rules."""
    scene = evidence.items[0].source.scene
    out = []
    for kind in looked_for():
        targets = kind.targets(scene)
        where = scene.held if scene.held in targets else (targets or [""])[0]
        if where and not any(e.effect == kind.name for e in world.effects):
            out.append((kind.name, where))
    return out


def tries(name: str, where: str) -> list[EffectInstance]:
    """An effect at every size of every parameter, one parameter at a time."""
    return [EffectInstance.of(name, where, **{k: v}) for k, values in effect(name).sizes.items() for v in values]


def profile(evidence: ContactEvidence, world: World, where: Sequence[tuple[str, str]]) -> list[Score]:
    """The best size of each effect beside those of `world`, by the drop of the squared residual; best first.

    One of which no size changes the residual by more than noise would has the gain -inf.
    """
    probes = [p for name, at in where for p in tries(name, at)]
    (base,), rows = evidence.residuals([world]), evidence.residuals([world.add(p) for p in probes])
    best: dict[tuple[str, str], Score] = {}
    for probe, r in zip(probes, rows, strict=True):
        moved = float(np.sum((r - base) ** 2))
        score = Score(probe, float(base @ base - r @ r) if moved > FELT**2 else -np.inf)
        if score.key not in best or score.gain > best[score.key].gain:
            best[score.key] = score
    return sorted(best.values(), key=lambda s: -s.gain)


FELT = 5.0  # standard deviations by which some size must move the residual for an effect to be excited
