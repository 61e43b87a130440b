"""Measure in images the borders and board corners that a world predicts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from vispeg.identify.pictures.corners import corners_of
from vispeg.identify.pictures.points import Points, pixels
from vispeg.identify.pictures.sight import Sight
from vispeg.vision.borders import Borders, borders_of
from vispeg.vision.eye import delay_of, values_of
from vispeg.vision.predict import Predictor
from vispeg.vision.search import SMOOTH, search
from vispeg.worlds.world import World

SPACING = 3.0  # px between points along a border
ALONE = 3 * SMOOTH  # px to the next border: the search's kernel reaches as far


def gather(predictor: Predictor, sight: Sight, world: World, window: float) -> Points:
    """Return the predicted points of borders and board corners, each with its measured offset within `window` px."""
    name, geometry, parts = sight.camera.name, predictor.geometry, []
    for i, rgb, b in _drawn(predictor, sight, world):
        b = b.some(b.free.min(axis=1) > ALONE)
        parts.append(_points(i, b, search(rgb, b, window).along))
    points = _joined([*parts, *corners_of(geometry, sight, world, window)])
    if not len(points.frame) or not values_of(geometry.world, "rolling_shutter", name):
        return points
    # rolling shutter: rows are exposed at different times
    shift = pixels(geometry, sight, world, points) - points.pixel
    along = points.along - np.sum(shift * points.normal, axis=1)
    return replace(points, pixel=points.pixel + shift, along=along)


def outlined(predictor: Predictor, sight: Sight, world: World) -> Points:
    """Return the predicted border points without measuring them; their offsets are NaN."""
    return _joined([_points(i, b, np.full(len(b), np.nan)) for i, _, b in _drawn(predictor, sight, world)])


def _drawn(predictor: Predictor, sight: Sight, world: World) -> Iterator[tuple[int, np.ndarray, Borders]]:
    """Yield number, colour image and predicted borders of each frame with an image and measured joint angles."""
    name, frames = sight.camera.name, np.arange(len(sight))
    predictor.see(world)
    for i, q in zip(frames, sight.at(frames, -delay_of(predictor.world, name)), strict=True):
        rgb = sight.rgb(int(i)) if np.isfinite(q).all() else None
        if rgb is not None:
            yield int(i), rgb, borders_of(predictor.draw(name, q), predictor.geometry, step=SPACING)


def _points(frame: int, b: Borders, along: np.ndarray) -> Points:
    return Points(np.full(len(b), frame), b.body, b.local, b.pixel, b.normal, along, b.parts, b.depth)


def _joined(parts: Sequence[Points]) -> Points:
    """Concatenate the points of several frames."""
    if not parts:
        none, flat = np.zeros(0), np.zeros((0, 2))
        return Points(none.astype(int), none.astype(int), np.zeros((0, 3)), flat, flat, none, flat.astype(int), none)
    return Points(*(np.concatenate([getattr(p, key) for p in parts]) for key in Points.__dataclass_fields__))
