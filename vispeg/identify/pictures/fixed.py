"""Derivatives to the parameters of the freest model, from which the robot's errors have to be separated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vispeg.identify.pictures.align import free_world
from vispeg.identify.space import Space

if TYPE_CHECKING:
    from vispeg.identify.pictures.evidence import BorderEvidence


def slopes(evidence: BorderEvidence) -> list[np.ndarray]:
    """Return for each item the derivatives (n, k) of the weighted misplacement per typical size of each parameter."""
    cameras = list(dict.fromkeys(i.sight.camera.name for i in evidence.items))
    world, free = free_world(evidence.settled, evidence.geometry.scene.joints, cameras, evidence.freed)
    space = Space(world, free)
    u = np.clip(space.start, *space.bounds)
    here, columns = evidence.misplaced(space.at(u)), []
    for step, axis in zip(space.steps(u), np.eye(len(u)), strict=True):
        moved = evidence.misplaced(space.at(u + step * axis))
        pairs = zip(evidence.items, moved, here, strict=True)
        columns.append([evidence.weighted(i, (m - h)) / step for i, m, h in pairs])
    return [np.stack([c[i] for c in columns], 1) for i in range(len(evidence.items))]
