"""From sights to evidence: aligned on those to fit; those to judge on are looked at from there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.identify.pictures.align import WINDOWS, align
from vispeg.identify.pictures.evidence import BorderEvidence, Item
from vispeg.identify.pictures.gather import gather
from vispeg.identify.pictures.points import Points
from vispeg.identify.pictures.posture import steadied
from vispeg.identify.pictures.robust import noise_of, trust
from vispeg.identify.pictures.sight import Sight
from vispeg.robots.scene import Scene
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World


def border_evidence(
    scene: Scene, fitted: Sequence[Sight], held_out: Sequence[Sight], world: World, robot: float | None = None
) -> tuple[BorderEvidence, BorderEvidence]:
    """Edges of the sights to fit and of those to judge on, both found from one alignment on those to fit.

    `robot` is the standard deviation of each joint's angle in each frame, rad; estimated where None.
    """
    cameras = list({s.camera.name: s.camera for s in (*fitted, *held_out)}.values())
    with Predictor(scene, cameras) as predictor:
        settled, points = align(predictor, fitted, world)
        judged = [gather(predictor, s, settled, WINDOWS[-1]) for s in held_out]
        geometry = predictor.geometry
    away, to_judge = (
        [steadied(geometry, s, settled, p) for s, p in zip(sights, edges, strict=True)]
        for sights, edges in ((fitted, points), (held_out, judged))
    )
    noise = {
        name: noise_of(np.concatenate([a for a, s in zip(away, fitted, strict=True) if s.camera.name == name]))
        for name in dict.fromkeys(s.camera.name for s in fitted)
    }
    evidence = BorderEvidence(geometry, _items(fitted, points, away, noise), settled, robot)
    return evidence, BorderEvidence(geometry, _items(held_out, judged, to_judge, noise), settled, evidence.robot)


def _items(
    sights: Sequence[Sight], points: Sequence[Points], away: Sequence[np.ndarray], noise: dict[str, float]
) -> list[Item]:
    out = []
    for sight, edges, off in zip(sights, points, away, strict=True):
        sigma = noise.get(sight.camera.name) or noise_of(off)
        out.append(Item(sight, edges, trust(off, sigma), np.array([sigma])))
    return out
