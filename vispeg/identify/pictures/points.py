"""Border points that a world predicts in a sight, the edges found near them, and their pixels in other worlds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vispeg.identify.pictures.sight import Sight
from vispeg.vision.eye import delay_of, values_of
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

PENALTY = 1e3  # residual in noise units of a point that a world puts behind the camera
TRUSTED = 0.05  # weight above which an edge is compared
INSTANT = 5e-3  # s, step of the finite difference for a pixel's speed


@dataclass(frozen=True, eq=False)
class Points:
    """All border points that one world predicts in a sight.

    Attributes:
        frame: (n,) index of the frame.
        body, local: the body that carries each point, and the point in the body's frame, (n, 3) m.
        pixel, normal: (n, 2) predicted pixel, and unit normal of the border from the nearer to the farther part.
        along: (n,) px along the normal from there to the edge in the picture; NaN without an edge.
        parts: (n, 2) labels of the nearer and the farther part.
        depth: (n,) m of the nearer part, along the optical axis.
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
        """Select points by indices or by a mask (n,) bool."""
        return Points(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Item:
    """Distances of edges from borders in one sight, as one column.

    It has the interface of `vispeg.identify.channels.Item`; `kind`, `beside` and `nj` are constants here.

    Attributes:
        sight, points: the frames, and their n border points.
        trust: (n,) weight of each point in [0, 1], 0 without an edge.
        sigma: (1,) px, standard deviation of an edge.
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
        """Measured distance of each edge from its border, (n, 1) px; 0 without an edge."""
        return np.nan_to_num(self.points.along)[:, None]

    @cached_property
    def valid(self) -> np.ndarray:
        """Whether each point is compared, (n, 1) bool."""
        return (self.trust > TRUSTED)[:, None]

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.sight.name

    def misplaced(self, geometry: Geometry, world: World) -> np.ndarray:
        """Return (n,) px along the normals from a world's borders to the edges; NaN without an edge."""
        return misplacement(geometry, self.sight, world, self.points)

    def weighted(self, away: np.ndarray) -> np.ndarray:
        """Return misplacements (n,) px in noise units, times the roots of the weights; 0 if not `valid`."""
        r = np.where(np.isnan(away) & np.isfinite(self.points.along), PENALTY, np.nan_to_num(away))
        return np.clip(r / self.sigma[0], -PENALTY, PENALTY) * np.sqrt(self.trust) * self.valid[:, 0]


def pixels(
    geometry: Geometry, sight: Sight, world: World, points: Points, joints: np.ndarray | None = None
) -> np.ndarray:
    """Return the pixels (n, 2) of the points in a world; NaN behind the camera or if no angles were measured.

    A camera delay shows an earlier posture. With a rolling shutter, a row is exposed before or after the middle row, by
    its share of the read-out time, and each point moves on at its speed in the picture.

    Args:
        geometry: of the cell; it is moved.
        sight: the frames of the points.
        world: the world to place the points in.
        points: (n) border points.
        joints: (nj,) rad, added to all measured angles.
    """
    name = sight.camera.name
    geometry.place(world)
    readout = values_of(geometry.world, "rolling_shutter", name).get("readout", 0.0)
    frames = np.unique(points.frame)
    late = -delay_of(geometry.world, name)
    out = _at(geometry, name, points, frames, sight.at(frames, late) + (0.0 if joints is None else joints))
    if readout:
        speed = (_at(geometry, name, points, frames, sight.at(frames, late + INSTANT)) - out) / INSTANT
        after_middle = readout * (out[:, 1] / max(sight.camera.height - 1, 1) - 0.5)  # s
        out = out + speed * after_middle[:, None]
    return out


def misplacement(geometry: Geometry, sight: Sight, world: World, points: Points) -> np.ndarray:
    """Return (n,) px along the normals from the points as a world places them to the edges; NaN without an edge."""
    moved = pixels(geometry, sight, world, points) - points.pixel
    return points.along - np.sum(moved * points.normal, axis=1)


def _at(geometry: Geometry, name: str, points: Points, frames: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the pixels (n, 2) of points with each of some frames (k,) at its angles (k, nj) rad."""
    out = np.full((len(points.frame), 2), np.nan)
    for frame, q in zip(frames, angles, strict=True):
        if np.isfinite(q).all():
            geometry.at(q)
            rows = points.frame == frame
            out[rows] = geometry.project(name, points.body[rows], points.local[rows])
    return out
