"""Border points of a sight: where they were predicted, where the picture has them, where another world puts them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.identify.pictures.sight import Sight
from vispeg.vision.borders import Borders, borders_of
from vispeg.vision.eye import delay_of, values_of
from vispeg.vision.geometry import Geometry
from vispeg.vision.predict import Predictor
from vispeg.vision.search import search
from vispeg.worlds.world import World

SPACING = 3.0  # px between points along a border
RIVAL = 0.7  # of an edge's strength, from which on another one in the window makes it doubtful
BESIDE = 2.0  # px from a border at which both its sides must be what they are there
FAINT = 15.0  # grey levels, the step of an edge that texture and shadows may make as well
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
        """Some of the points."""
        return Points(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def gather(predictor: Predictor, sight: Sight, world: World, window: float) -> Points:
    """The border points that a world predicts, each sought within `window` px in the picture."""
    name, geometry, parts = sight.camera.name, predictor.geometry, []
    for i, rgb, b in _drawn(predictor, sight, world):
        ahead, behind = (geometry.cast(name, b.pixel + side * b.normal)[2] for side in (BESIDE, -BESIDE))
        b = b.some((ahead == b.parts[:, 1]) & (behind == b.parts[:, 0]))
        edges = search(rgb, b, window)
        parts.append(_points(i, b, np.where((edges.rival < RIVAL) & (edges.strength > FAINT), edges.along, np.nan)))
    points = _joined(parts)
    if not parts or not values_of(world, "rolling_shutter", name):
        return points
    shift = pixels(geometry, sight, world, points) - points.pixel  # rows that were exposed at other times
    along = points.along - np.sum(shift * points.normal, axis=1)
    return replace(points, pixel=points.pixel + shift, along=along)


def outlined(predictor: Predictor, sight: Sight, world: World) -> Points:
    """The border points that a world predicts, sought nowhere."""
    return _joined([_points(i, b, np.full(len(b), np.nan)) for i, _, b in _drawn(predictor, sight, world)])


def _drawn(predictor: Predictor, sight: Sight, world: World) -> Iterator[tuple[int, np.ndarray, Borders]]:
    """Number, picture and predicted borders of each frame that has a picture at measured angles."""
    name, frames = sight.camera.name, np.arange(len(sight))
    predictor.see(world)
    for i, q in zip(frames, sight.at(frames, -delay_of(world, name)), strict=True):
        rgb = sight.rgb(int(i)) if np.isfinite(q).all() else None
        if rgb is not None:
            yield int(i), rgb, borders_of(predictor.draw(name, q), predictor.geometry, step=SPACING)


def _points(frame: int, b: Borders, along: np.ndarray) -> Points:
    return Points(np.full(len(b), frame), b.body, b.local, b.pixel, b.normal, along, b.parts, b.depth)


def _joined(some: Sequence[Points]) -> Points:
    """Points of several frames, one after the other."""
    if not some:
        none, flat = np.zeros(0), np.zeros((0, 2))
        return Points(none.astype(int), none.astype(int), np.zeros((0, 3)), flat, flat, none, flat.astype(int), none)
    return Points(*(np.concatenate([getattr(p, key) for p in some]) for key in Points.__dataclass_fields__))


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
