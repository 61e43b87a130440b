"""Border points of a sight: where they were predicted, and where another world puts them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.identify.pictures.sight import Sight
from vispeg.vision.eye import delay_of, values_of
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

INSTANT = 5e-3  # s over which a pixel's speed is taken


@dataclass(frozen=True, eq=False)
class Points:
    """All border points of a sight that one world predicted.

    Attributes:
        frame: (n,) index of the frame.
        body, local: which body carries a point, and where (n, 3) in its axes, m.
        pixel, normal: (n, 2) where it was predicted, and its border's normal.
        along: (n,) px from there to the edge in the picture; NaN where there is none.
        parts: (n, 2) labels of the nearer and the farther part.
        depth: (n,) m.
    """

    frame: np.ndarray
    body: np.ndarray
    local: np.ndarray
    pixel: np.ndarray
    normal: np.ndarray
    along: np.ndarray
    parts: np.ndarray
    depth: np.ndarray

    def only(self, rows: np.ndarray) -> Points:
        """Give some of the points."""
        return Points(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def pixels(
    geometry: Geometry, sight: Sight, world: World, points: Points, joints: np.ndarray | None = None
) -> np.ndarray:
    """(n, 2) px where a world puts the points; `joints` (nj,) rad are added to all measured angles."""
    name = sight.camera.name
    geometry.place(world)
    readout = values_of(world, "rolling_shutter", name).get("readout", 0.0)
    frames = np.unique(points.frame)
    late = -delay_of(world, name)
    out = _at(geometry, name, points, frames, sight.at(frames, late) + (0.0 if joints is None else joints))
    if readout:
        moved = _at(geometry, name, points, frames, sight.at(frames, late + INSTANT)) - out
        after = readout * (out[:, 1] / max(sight.camera.height - 1, 1) - 0.5)
        out = out + moved * (after / INSTANT)[:, None]
    return out


def misplacement(geometry: Geometry, sight: Sight, world: World, points: Points) -> np.ndarray:
    """(n,) px along the normals from where a world puts the points to the edges in the pictures."""
    moved = pixels(geometry, sight, world, points) - points.pixel
    return points.along - np.sum(moved * points.normal, axis=1)


def _at(geometry: Geometry, name: str, points: Points, frames: np.ndarray, angles: np.ndarray) -> np.ndarray:
    out = np.full((len(points.frame), 2), np.nan)
    for frame, q in zip(frames, angles, strict=True):
        if np.isfinite(q).all():
            geometry.at(q)
            rows = points.frame == frame
            out[rows] = geometry.project(name, points.body[rows], points.local[rows])
    return out
