"""Residuals of one camera's frames, every channel over the image and over distance: borders, corners, depth, light."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.vision.compare import Compared

POINTS = 4000  # borders and corners of a camera that are kept
DISTANCES = 12  # bins
CELLS = (8, 6)  # of the image, across and down
EVERY = 7  # pixel that is counted
LEAST = 20  # pixels of a cell from which its RMS is told


def over_image_and_distance(mine: Sequence[Compared]) -> dict[str, np.ndarray]:
    """Arrays by name, for one camera.

    `size` (2,) px. Of borders and corners that were found, `POINTS` at most: `pixel`, `normal` (n, 2), `along` (n,) px,
    `depth` (n,) m, `time` (n,) s. Over distance, (k, 4) of m, median, spread, readings: `border_distance` px,
    `distance` mm of depth on the interior, `grey_distance` grey levels. Over the image, (6, 8) RMS of its cells, NaN
    where there are too few: `depth_image` mm, `grey_image` grey levels.
    """
    size = np.array([mine[0].frame.camera.width, mine[0].frame.camera.height])
    table = np.concatenate([np.zeros((0, 7)), *(rows for shot in mine for rows in _geometry(shot))])
    thin = table[:: max(1, -(-len(table) // POINTS))]
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
    """(n, 7) u, v, normal, px along it, m, s of the borders that were found, and of corners along u and along v."""
    out, time = [], shot.frame.time
    if shot.displacements is not None:
        b, along = shot.borders, shot.displacements.along
        table = np.column_stack([b.pixel, b.normal, along, b.depth, np.full(len(b), time)])
        out.append(table[np.isfinite(along)])
    if shot.corners is not None:
        c = shot.corners
        for axis, normal in enumerate(np.eye(2)):
            many = np.tile(normal, (len(c.depth), 1))
            out.append(np.column_stack([c.pixel, many, c.away[:, axis], c.depth, np.full(len(c.depth), time)]))
    return out


def _pixels(mine: Sequence[Compared], light: bool) -> np.ndarray:
    """(n, 4) u, v, m and the error of depth in mm on the interior, or of light in grey levels, of every few pixels."""
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
    """(rows, columns) RMS of the errors in the image's cells."""
    at = np.clip((table[:, :2] / size * CELLS).astype(int), 0, np.array(CELLS) - 1)
    where, count = CELLS[0] * at[:, 1] + at[:, 0], CELLS[0] * CELLS[1]
    total = np.bincount(where, table[:, 3] ** 2, count)
    number = np.bincount(where, minlength=count)
    rms = np.sqrt(total / np.maximum(number, 1))
    return np.where(number >= LEAST, rms, np.nan).reshape(CELLS[::-1])


def _binned(z: np.ndarray, e: np.ndarray) -> np.ndarray:
    """(k, 4) of bins of equal numbers: distance m, median error, spread, readings; empty with too few.

    The spread is 1.48 times the median size of what is off the median: a sigma to which things that the model lacks do
    not add.
    """
    if len(z) < DISTANCES:
        return np.zeros((0, 4))
    edges = np.quantile(z, np.linspace(0, 1, DISTANCES + 1))
    cell = np.clip(np.searchsorted(edges, z, side="right") - 1, 0, DISTANCES - 1)
    rows = []
    for k in range(DISTANCES):
        here = e[cell == k]
        if len(here):
            middle = float(np.median(here))
            spread = 1.4826 * float(np.median(np.abs(here - middle)))
            rows.append((float(np.median(z[cell == k])), middle, spread, len(here)))
    return np.array(rows)
