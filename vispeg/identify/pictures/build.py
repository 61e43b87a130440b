"""From sights to evidence: aligned on those to fit; those to judge on are looked at from there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.identify.pictures.align import WINDOWS, align, noise_of, trust
from vispeg.identify.pictures.evidence import BorderEvidence, Item
from vispeg.identify.pictures.points import Points, gather
from vispeg.identify.pictures.sight import Sight
from vispeg.robots.scene import Scene
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World


def border_evidence(
    scene: Scene, fitted: Sequence[Sight], held_out: Sequence[Sight], world: World
) -> tuple[BorderEvidence, BorderEvidence]:
    """Edges of the sights to fit and of those to judge on, both found from one alignment on those to fit."""
    cameras = list({s.camera.name: s.camera for s in (*fitted, *held_out)}.values())
    with Predictor(scene, cameras) as predictor:
        settled, points, _ = align(predictor, fitted, world)
        judged = [gather(predictor, s, settled, WINDOWS[-1]) for s in held_out]
        geometry = predictor.geometry
    noise = {
        name: noise_of(np.concatenate([p.along for p, s in zip(points, fitted, strict=True) if s.camera.name == name]))
        for name in dict.fromkeys(s.camera.name for s in fitted)
    }
    evidence = BorderEvidence(geometry, _items(fitted, points, noise), settled)
    return evidence, BorderEvidence(geometry, _items(held_out, judged, noise), settled, evidence.robot)


def _items(sights: Sequence[Sight], points: Sequence[Points], noise: dict[str, float]) -> list[Item]:
    out = []
    for sight, edges in zip(sights, points, strict=True):
        sigma = noise.get(sight.camera.name) or noise_of(edges.along)
        out.append(Item(sight, edges, trust(edges.along, sigma), np.array([sigma])))
    return out
