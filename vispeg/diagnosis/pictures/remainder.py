"""Residual of the final world and its dependence on inputs: fitted on some views, judged on the others.

A moved part, a distorted picture or a drift is not in the library, so it appears here, in px.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.core.rules import RULES
from vispeg.identify.pictures.points import Points, pixels
from vispeg.identify.pictures.robust import fit, noise_of, trust
from vispeg.identify.pictures.sight import Sight
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

CELLS = (6, 5)  # of the image, across and down
SMALL, FAR = 1e-4, 0.02  # m: step of a derivative, and largest displacement of a fixture
PENALTY = 3.0  # ridge in points: damps cells with few points


@dataclass(frozen=True)
class Left:
    """A share of the held-out remainder that one input predicts, RMS px of that, and where it is strongest."""

    input: str
    share: float
    size: float
    where: str


def left_over(
    fitted: Sequence[tuple[Sight, Points]], judged: Sequence[tuple[Sight, Points]], parts: Sequence[str]
) -> list[Left]:
    """Rank inputs by how much of the held-out misplacements a field over them predicts.

    Args:
        fitted, judged: sights with the border points as the final world predicts them, sought in a wide window.
        parts: names of the labels from 1.
    """
    a, b = _table(fitted), _table(judged)
    noise = max(noise_of(np.concatenate([a["away"], b["away"]])), 0.1)
    scales = [max(scale, noise) for scale in (3.0, 1.5, 0.75, 0.0, 0.0)]  # px
    out = []
    for name, key, words in (
        ("place in the image", "cell", [_cell(i) for i in range(CELLS[0] * CELLS[1])]),
        ("part", "part", ["nothing", *parts]),
        ("distance", "distance", _distances()),
    ):
        most = (0.0, "")  # largest drop in one bin, and the bin in words
        design = (_bins(a, key), _bins(b, key))
        gain = square = weight = 0.0
        for value in np.unique(design[0]):
            rows, held = design[0] == value, design[1] == value
            if min(rows.sum(), held.sum()) < RULES.left_points:
                continue
            shift = fit(a["normal"][rows], a["away"][rows], scales, PENALTY / np.square(scales))
            predicted = b["normal"][held] @ shift
            away = b["away"][held]
            w = np.maximum(trust(away, noise), trust(away - predicted, noise))
            drop = float(np.sum(w * (away**2 - (away - predicted) ** 2)))
            if drop > 0:
                gain, square, weight = gain + drop, square + float(np.sum(predicted**2)), weight + held.sum()
                most = max(most, (drop, words[int(value)] if int(value) < len(words) else str(value)))
        total = float(np.sum(np.minimum(b["away"] ** 2, 64.0)))  # px^2; at most 8 px count
        size = float(np.sqrt(square / weight)) if weight else 0.0
        out.append(Left(name, max(gain, 0.0) / max(total, 1e-9), size, most[1]))
    return sorted(out, key=lambda x: -x.share)


def moved_most(
    geometry: Geometry,
    first: Sequence[tuple[Sight, Points]],
    other: Sequence[tuple[Sight, Points]],
    world: World,
) -> tuple[str, float] | None:
    """Find the static object whose position differs most between two groups of sights, and the distance, mm.

    Args:
        geometry: of the scene.
        first, other: sights with their border points, sought in a wide window.
        world: gives the nominal poses.

    Returns:
        The object and its distance; None if too few points show any of them.
    """
    model, apart = geometry.model, list[tuple[str, float]]()
    for name in geometry.scene.things:
        if model.body_weldid[model.body(name).id] == 0:
            one, two = (_displacement(geometry, group, world, model.body(name).id) for group in (first, other))
            if one is not None and two is not None:
                apart.append((name, 1e3 * float(np.linalg.norm(np.subtract(one, two)))))
    return max(apart, key=lambda thing: thing[1], default=None)


def _displacement(
    geometry: Geometry, group: Sequence[tuple[Sight, Points]], world: World, body: int
) -> tuple[float, ...] | None:
    """Return a body's displacement (3,) m in its own frame; None if too few points show it."""
    columns, away = [], []
    for sight, p in group:
        p = p.only(np.flatnonzero((p.body == body) & np.isfinite(p.along)))
        if len(p.frame):
            here = pixels(geometry, sight, world, p)
            moved = [pixels(geometry, sight, world, replace(p, local=p.local + SMALL * a)) - here for a in np.eye(3)]
            columns.append(np.stack([np.sum(m * p.normal, axis=1) / SMALL for m in moved], axis=1))
            away.append(p.along - np.sum((here - p.pixel) * p.normal, axis=1))
    slope, misplaced = np.concatenate(columns or [np.zeros((0, 3))]), np.concatenate(away or [np.zeros(0)])
    good = np.isfinite(slope).all(axis=1) & np.isfinite(misplaced)
    slope, misplaced = slope[good], misplaced[good]
    if len(misplaced) < RULES.left_points:
        return None
    scales = (4.0, 2.0, 1.0, 0.5, 0.5)  # px, from the whole window down to inlier edges
    return tuple(fit(slope, misplaced, scales, 1 / FAR**2).tolist())


def _table(group: Sequence[tuple[Sight, Points]]) -> dict[str, np.ndarray]:
    """Collect the readings of all points with an edge: misplacement, normal, depth, part, and cell of the image."""
    rows = []
    for sight, p in group:
        good = np.isfinite(p.along)
        size = np.array([sight.camera.width, sight.camera.height])
        cell = np.clip((p.pixel + 0.5) / size * CELLS, 0, np.array(CELLS) - 1e-9).astype(int)
        rows.append(
            {
                "away": p.along[good],
                "normal": p.normal[good],
                "depth": p.depth[good],
                "part": p.parts[good, 0],
                "cell": (cell[:, 1] * CELLS[0] + cell[:, 0])[good],
            }
        )
    return {key: np.concatenate([r[key] for r in rows]) for key in rows[0]}


def _bins(table: dict[str, np.ndarray], key: str) -> np.ndarray:
    """Return the bin (n,) of each reading in an input: its cell or part, or its range of `DISTANCES`."""
    if key != "distance":
        return table[key]
    return np.digitize(table["depth"], DISTANCES)


DISTANCES = np.array([0.1, 0.15, 0.2, 0.3, 0.5, 1.0])  # m


def _distances() -> list[str]:
    """Return the ranges of `DISTANCES` in words."""
    edges = ["0", *(f"{d:g}" for d in DISTANCES), "more"]
    return [f"{a} to {b} m" for a, b in zip(edges, edges[1:], strict=False)]


def _cell(index: int) -> str:
    """Return in words where a cell of the image lies."""
    row, column = divmod(index, CELLS[0])
    across = ("left", "middle", "right")[min(column * 3 // CELLS[0], 2)]
    down = ("top", "middle", "bottom")[min(row * 3 // CELLS[1], 2)]
    return across if down == across else f"{down} {across}"
