"""Measure a calibration board's corners as border points, searched along u and v around their predicted pixels."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from vispeg.identify.pictures.points import Points
from vispeg.identify.pictures.sight import Sight
from vispeg.vision.board import Corners, Look, corners_in, look_at
from vispeg.vision.eye import delay_of
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

PATCHES = 3  # number of patches along each side of a board; each patch has a label of its own
ROOM = 0  # index of the static body


def looks_of(geometry: Geometry, sight: Sight, world: World) -> dict[int, Look]:
    """Return the views by frame that show the board, each from the camera pose of a world."""
    name, out = sight.camera.name, {}
    geometry.place(world)
    for i in range(len(sight)) if sight.board is not None else ():
        (q,) = sight.at(np.array([i]), -delay_of(geometry.world, name))
        if np.isfinite(q).all() and (view := sight.corners(i)) is not None:
            out[i] = look_at(geometry, name, q, view)
    return out


def corners_of(geometry: Geometry, sight: Sight, world: World, window: float) -> list[Points]:
    """Return two points per corner and frame, with normals along u and v; an offset beyond `window` px is NaN."""
    board = sight.board
    if board is None:
        return []
    columns, rows = board.grid
    row, column = np.divmod(np.arange(columns * rows), columns)
    patch = PATCHES * (row * PATCHES // rows) + column * PATCHES // columns
    out, label = [], 1 + len(geometry.scene.parts)
    for frame, c in corners_in(geometry, sight.camera.name, board, looks_of(geometry, sight, world)).items():
        ids, where, pixel, away, depth = (np.repeat(getattr(c, f.name), 2, axis=0) for f in fields(Corners))
        n, normal = len(ids), np.tile(np.eye(2), (len(c.ids), 1))
        along = np.where(np.linalg.norm(away, axis=1) < window, np.sum(away * normal, axis=1), np.nan)
        parts = np.column_stack([np.full(n, label), label + 1 + patch[ids]])
        points = Points(np.full(n, frame), np.full(n, ROOM), where, pixel, normal, along, parts, depth)
        out.append(points.only(np.flatnonzero(np.isfinite(pixel).all(axis=1))))
    return out
