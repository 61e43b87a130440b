"""Border points of a sight: their predicted pixels, and their pixels in other worlds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.identify.pictures.sight import Sight
from vispeg.vision.eye import delay_of, values_of
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

INSTANT = 5e-3  # s, step of the finite difference for a pixel's speed


@dataclass(frozen=True, eq=False)
class Points:
    """All border points that one world predicts in a sight.

    Attributes:
        frame: (n,) index of the frame.
        body, local: the body that carries each point, and the point in the body's frame, (n, 3) m.
        pixel, normal: (n, 2) predicted pixel, and normal of the border.
        along: (n,) px from there to the edge in the picture; NaN without an edge.
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
        """Return the points of some rows."""
        return Points(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def pixels(
    geometry: Geometry, sight: Sight, world: World, points: Points, joints: np.ndarray | None = None
) -> np.ndarray:
    """Return (n, 2) px of the points in a world; `joints` (nj,) rad are added to all measured angles."""
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
    """Return (n,) px along the normals from the points as a world places them to the edges in the pictures."""
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
