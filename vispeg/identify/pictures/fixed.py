"""Derivatives to the parameters that the alignment freed, from which the robot's errors have to be separated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.identify.pictures.align import free_world
from vispeg.identify.pictures.points import Item
from vispeg.identify.space import Space
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World


def slopes(geometry: Geometry, items: Sequence[Item], settled: World, freed: tuple[str, ...]) -> list[np.ndarray]:
    """Return for each item the derivatives (n, k) of the weighted misplacement per typical size of each parameter.

    They are taken at the aligned world `settled`; `freed` are effects that the alignment freed beside the usual ones.
    """
    cameras = list(dict.fromkeys(i.sight.camera.name for i in items))
    world, free = free_world(settled, geometry.scene.joints, cameras, freed)
    space = Space(world, free)
    u = np.clip(space.start, *space.bounds)
    here, columns = _misplaced(geometry, items, space.at(u)), []
    for step, axis in zip(space.steps(u), np.eye(len(u)), strict=True):
        moved = _misplaced(geometry, items, space.at(u + step * axis))
        columns.append([i.weighted(m - h) / step for i, m, h in zip(items, moved, here, strict=True)])
    return [np.stack([c[i] for c in columns], 1) for i in range(len(items))]


def _misplaced(geometry: Geometry, items: Sequence[Item], world: World) -> list[np.ndarray]:
    return [item.misplaced(geometry, world) for item in items]
