"""Residuals of one camera's frames over the image and over distance: of borders, corners, depth and light."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.robust import spread
from vispeg.vision.compare import Compared

POINTS = 4000  # most borders and corners of a camera that are kept
DISTANCES = 12  # bins
CELLS = (8, 6)  # of the image, across and down
EVERY = 7  # one pixel in so many is used
LEAST = 20  # fewest pixels of a cell with an RMS


def over_image_and_distance(mine: Sequence[Compared]) -> dict[str, np.ndarray]:
    """Return arrays by name, for one camera.

    `size` (2,) px. Of borders and corners that were found, `POINTS` at most: `pixel`, `normal` (n, 2), `along` (n,) px,
    `depth` (n,) m, `time` (n,) s. Over distance, as `_binned`: `border_distance` px,
    `distance` mm of depth on the interior, `grey_distance` grey levels. Over the image, (6, 8) RMS of its cells, NaN
    where there are too few: `depth_image` mm, `grey_image` grey levels.
    """
    size = np.array([mine[0].frame.camera.width, mine[0].frame.camera.height])
    table = np.concatenate([np.zeros((0, 7)), *(rows for shot in mine for rows in _geometry(shot))])
    thin = table[:: max(1, -(-len(table) // POINTS))]  # rounded up
    names = {"pixel": np.s_[:, :2], "normal": np.s_[:, 2:4], "along": np.s_[:, 4], "depth": np.s_[:, 5]}
    depth, grey = (_pixels(mine, light) for light in (False, True))
    return {
        "size": size,
        **{name: thin[columns] for name, columns in names.items()},
        "time": thin[:, 6],
        "border_distance": _binned(table[:, 5], table[:, 4]),
        "distance": _binned(depth[:, 2], depth[:, 3]),
        "grey_distance": _binned(grey[:, 2], grey[:, 3]),
        "depth_image": _cells(depth, size),
        "grey_image": _cells(grey, size),
    }


def _geometry(shot: Compared) -> list[np.ndarray]:
    """Return rows (n, 7) of the borders that were found, and two rows for each corner, along u and along v.

    The columns are u and v in px, normal (2), misplacement along it in px, depth in m, time in s.
    """
    out, time = [], shot.frame.time
    if shot.displacements is not None:
        b, along = shot.borders, shot.displacements.along
        table = np.column_stack([b.pixel, b.normal, along, b.depth, np.full(len(b), time)])
        out.append(table[np.isfinite(along)])
    if shot.corners is not None:
        c = shot.corners
        for axis, normal in enumerate(np.eye(2)):
            normals = np.tile(normal, (len(c.depth), 1))
            out.append(np.column_stack([c.pixel, normals, c.away[:, axis], c.depth, np.full(len(c.depth), time)]))
    return out


def _pixels(mine: Sequence[Compared], light: bool) -> np.ndarray:
    """Return (n, 4) of one pixel in `EVERY`: u and v in px, depth in m, and an error.

    That is of depth on the interior, mm, or, if `light`, of light, grey levels.
    """
    parts: list[np.ndarray] = [np.zeros((0, 4))]
    for shot in mine:
        if light and shot.light is not None:
            error, good = shot.light.error.mean(axis=2), np.ones(shot.rendering.depth.shape, bool)
        elif not light and shot.depth is not None:
            error, good = 1e3 * shot.depth.error, shot.depth.interior
        else:
            continue
        v, u = np.nonzero(good & np.isfinite(error) & (shot.rendering.depth > 0))
        v, u = v[::EVERY], u[::EVERY]
        parts.append(np.column_stack([u, v, shot.rendering.depth[v, u], error[v, u]]))
    return np.concatenate(parts)


def _cells(table: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return the RMS (rows, columns) of the errors in the image's cells."""
    at = np.clip((table[:, :2] / size * CELLS).astype(int), 0, np.array(CELLS) - 1)
    where, count = CELLS[0] * at[:, 1] + at[:, 0], CELLS[0] * CELLS[1]
    total = np.bincount(where, table[:, 3] ** 2, count)
    number = np.bincount(where, minlength=count)
    rms = np.sqrt(total / np.maximum(number, 1))
    return np.where(number >= LEAST, rms, np.nan).reshape(CELLS[::-1])


def _binned(z: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Return (k, 4) of bins with equal numbers of readings: distance m, median error, spread, number of readings.

    Empty with too few. The spread is a robust standard deviation, to which things that the model lacks do not add.
    """
    if len(z) < DISTANCES:
        return np.zeros((0, 4))
    edges = np.quantile(z, np.linspace(0, 1, DISTANCES + 1))
    cell = np.clip(np.searchsorted(edges, z, side="right") - 1, 0, DISTANCES - 1)
    rows = []
    for k in range(DISTANCES):
        errors = e[cell == k]
        if len(errors):
            rows.append((float(np.median(z[cell == k])), float(np.median(errors)), spread(errors), len(errors)))
    return np.array(rows)
