"""Border points of a sight and the edges read at them: their predicted pixels, and their pixels in other worlds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vispeg.identify.pictures.sight import Sight
from vispeg.vision.eye import delay_of, values_of
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

PENALTY = 1e3  # residual in noise units of a point that a world puts behind the camera
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


@dataclass(frozen=True)
class Item:
    """Readings of one sight as a column, with the interface of a joint channel's item.

    Attributes:
        sight, points, trust: the frames, their border points, and the weight in [0, 1] of each.
        sigma: (1,) px.
        valid: (n, 1) bool.
    """

    sight: Sight
    points: Points
    trust: np.ndarray
    sigma: np.ndarray
    kind = "border"
    beside = None
    nj = 1

    @cached_property
    def measured(self) -> np.ndarray:
        """Measured distance of each edge from its border, (n, 1) px."""
        return np.nan_to_num(self.points.along)[:, None]

    @cached_property
    def valid(self) -> np.ndarray:
        """(n, 1) bool."""
        return (self.trust > 0.05)[:, None]

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.sight.name

    def misplaced(self, geometry: Geometry, world: World) -> np.ndarray:
        """Return (n,) px along the normals from a world's borders to the edges; NaN without an edge."""
        return misplacement(geometry, self.sight, world, self.points)

    def weighted(self, away: np.ndarray) -> np.ndarray:
        """Return misplacements (n,) in noise units times their weights; those with weight 0 are 0."""
        r = np.where(np.isnan(away) & np.isfinite(self.points.along), PENALTY, np.nan_to_num(away))
        return np.clip(r / self.sigma[0], -PENALTY, PENALTY) * np.sqrt(self.trust) * self.valid[:, 0]


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
