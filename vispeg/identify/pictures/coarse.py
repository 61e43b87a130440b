"""A camera that is far from where it was believed, or late: its pose by the distance of predicted borders to edges.

Each picture becomes fields of distance to its nearest edge of one direction. A world's score is the mean of what its
borders find there, cut at a reach that shrinks: no edge has to be told from another, and no picture is drawn for a
trial. Poses on a grid, and delays, are scored; the best are refined and their borders drawn anew (chamfer matching:
Barrow, Tenenbaum, Bolles and Wolf, IJCAI 1977; from coarse to fine: Borgefors, IEEE TPAMI 10(6), 1988).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from vispeg.identify.pictures.gather import outlined
from vispeg.identify.pictures.points import Points, pixels
from vispeg.identify.pictures.sight import Sight
from vispeg.identify.space import Space
from vispeg.vision.geometry import Geometry
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World

DELAYS = np.arange(-0.06, 0.1201, 0.01)  # s; below 0 the joint log lags the camera
TURNS, SHIFTS = np.radians([-8.0, -4.0, 0.0, 4.0, 8.0]), np.array([-0.08, -0.04, 0.0, 0.04, 0.08])  # rad, m
REACHES = (40.0, 20.0, 10.0)  # px beyond which an edge is no nearer than any other
REFINED = (8, 3, 1)  # trials that are refined at each of them
STEPS, FINITE = 6, 0.05  # of refinement, and typical sizes of a finite difference: over a good part of a pixel
WAYS, ALIKE = 4, np.radians(35)  # directions of edges that are told apart, and what may lie between two of one
EDGES = 0.08  # share of the pixels, those of the steepest light, that are edges
FRAMES, SPARSE = 6, 120  # that are looked at, and border points in each
DEEP, FAR = 0.03, 5.0  # share of the distance, a px, that an edge in depth steps by; m where nothing is read
LOOSE = 25.0  # typical sizes of a camera's offset that the weak prior allows


@dataclass(frozen=True, eq=False)
class Outline:
    """A camera's borders in a few frames, and the fields of distance of these frames, (frames, WAYS, H, W) px."""

    sight: Sight
    points: Points
    fields: np.ndarray

    def distances(self, geometry: Geometry, world: World, reach: float) -> np.ndarray:
        """(n,) px from where a world puts the points to the nearest edges of their direction, `reach` at most."""
        p = self.points
        u, v = np.nan_to_num(pixels(geometry, self.sight, world, p), nan=-1.0).T
        height, width = self.fields.shape[2:]
        inside = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
        u, v = np.clip(u, 0, width - 1.001), np.clip(v, 0, height - 1.001)
        i, j = v.astype(int), u.astype(int)
        a, b, f, way = v - i, u - j, self.fields, _way(p.normal)
        k = p.frame
        upper = (1 - b) * f[k, way, i, j] + b * f[k, way, i, j + 1]
        lower = (1 - b) * f[k, way, i + 1, j] + b * f[k, way, i + 1, j + 1]
        return np.where(inside, np.minimum((1 - a) * upper + a * lower, reach), reach)


def brought_near(predictor: Predictor, sights: Sequence[Sight], world: World) -> list[World]:
    """Give the world with its cameras late, and with them elsewhere, where their borders lie nearest to edges.

    Args:
        predictor: of the cell.
        sights: of one or more cameras.
        world: has a `camera_offset` and a `camera_delay` of each camera.
    """
    out = []
    for trials in (_late, _elsewhere):
        near = world
        for camera in dict.fromkeys(s.camera.name for s in sights):
            sight = next(s for s in sights if s.camera.name == camera)
            rows = np.linspace(0, len(sight) - 1, min(FRAMES, len(sight))).round().astype(int)
            near = _near(predictor, sight.only(rows), near, list(trials(near, camera)))
        out.append(near)
    return out


def _near(predictor: Predictor, sight: Sight, world: World, trials: Sequence[World]) -> World:
    fields = _all_fields(sight)
    if fields is None:
        return world
    outline = _outline(predictor, sight, world, fields)
    for reach, count in zip(REACHES, REFINED, strict=True):
        score = [float(outline.distances(predictor.geometry, w, reach).mean()) for w in trials]
        best = [trials[i] for i in np.argsort(score)[:count]]
        outlines = [_outline(predictor, sight, w, fields) for w in best]
        refined = [_refined(predictor.geometry, o, w, reach) for o, w in zip(outlines, best, strict=True)]
        trials = [w for w, _ in sorted(refined, key=lambda r: r[1])]
        outline = _outline(predictor, sight, trials[0], fields)
    return trials[0]


def _outline(predictor: Predictor, sight: Sight, world: World, fields: np.ndarray) -> Outline:
    points = outlined(predictor, sight, world)
    rng = np.random.default_rng(0)
    chosen = [rng.permutation(np.flatnonzero(points.frame == k))[:SPARSE] for k in range(len(sight))]
    return Outline(sight, points.only(np.sort(np.concatenate(chosen))), fields)


def _late(world: World, camera: str) -> Iterator[World]:
    """Yield the world with a late camera, or a late log."""
    for delay in DELAYS:
        yield _with(world, camera, "camera_delay", delay=float(delay))


def _elsewhere(world: World, camera: str) -> Iterator[World]:
    """Yield the world with the camera elsewhere."""
    for rx, ry, x, y in product(TURNS, TURNS, SHIFTS, SHIFTS):
        yield _with(world, camera, "camera_offset", rx=float(rx), ry=float(ry), x=float(x), y=float(y))


def _with(world: World, camera: str, name: str, **values: float) -> World:
    changed = (e.with_values(**values) if (e.effect, e.where) == (name, camera) else e for e in world.effects)
    return replace(world, effects=tuple(changed))


def _refined(geometry: Geometry, outline: Outline, world: World, reach: float) -> tuple[World, float]:
    """Give the world after Gauss-Newton steps of the camera's offset and delay, and its score."""
    names = ("camera_offset", "camera_delay")
    camera = outline.sight.camera.name
    space = Space(world, [i for i, e in enumerate(world.effects) if e.effect in names and e.where == camera])
    (low, high), u = space.bounds, space.start
    r = outline.distances(geometry, space.at(u), reach)
    for _ in range(STEPS):
        near = r < reach
        if near.sum() < 10 * len(u):
            break
        steps = FINITE * np.sign(space.steps(u))
        moved = [
            outline.distances(geometry, space.at(u + h * a), reach) for h, a in zip(steps, np.eye(len(u)), strict=True)
        ]
        jac = np.stack([(m - r)[near] / h for m, h in zip(moved, steps, strict=True)], 1)
        scale = max(float(np.median(r[near])), 0.5)
        step = np.linalg.solve(jac.T @ jac / scale**2 + np.eye(len(u)) / LOOSE**2, -jac.T @ r[near] / scale**2)
        for shorter in (1.0, 0.5, 0.25):
            there = np.clip(u + shorter * step, low, high)
            away = outline.distances(geometry, space.at(there), reach)
            if away.mean() < r.mean():
                break
        else:
            break
        u, r = there, away
    return space.at(u), float(r.mean())


def _all_fields(sight: Sight) -> np.ndarray | None:
    """(frames, WAYS, H, W) of a sight: of steps in depth where all frames have depth, else in colour; None without."""
    depths = [sight.depth(i) for i in range(len(sight))]
    if all(d is not None for d in depths):
        return np.stack([_fields(_log(d)[..., None], DEEP) for d in depths if d is not None])
    pictures = [sight.rgb(i) for i in range(len(sight))]
    some = [p for p in pictures if p is not None]
    return np.stack([_fields(p, 0.0) for p in some]) if len(some) == len(pictures) else None


def _log(depth: np.ndarray) -> np.ndarray:
    """(H, W) logarithm of a depth picture, small gaps closed; what has no reading is far."""
    import cv2

    return np.log(cv2.medianBlur(np.where(depth > 0, depth, FAR).astype(np.float32), 5))


def _fields(picture: np.ndarray, least: float) -> np.ndarray:
    """(WAYS, H, W) float32 px to the nearest edge of each direction, `REACHES[0]` at most.

    Args:
        picture: (H, W, C).
        least: step that an edge has at least.
    """
    import cv2

    smooth = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 1.0)
    smooth = smooth.reshape(picture.shape)
    across, down = (cv2.Sobel(smooth, cv2.CV_32F, dx, dy).reshape(picture.shape) / 8 for dx, dy in ((1, 0), (0, 1)))
    size = across**2 + down**2
    most = size.argmax(-1)[..., None]
    across, down, size = (np.take_along_axis(x, most, -1)[..., 0] for x in (across, down, size))
    ridge = size >= max(float(np.quantile(size, 1 - EDGES)), least**2)
    angle, out = np.arctan2(down, across), []
    for k in range(WAYS):
        off = np.abs((angle - k * np.pi / WAYS + np.pi / 2) % np.pi - np.pi / 2)
        free = np.where(ridge & (off < ALIKE), 0, 255).astype(np.uint8)
        out.append(np.minimum(cv2.distanceTransform(free, cv2.DIST_L2, 5), REACHES[0]))
    return np.stack(out)


def _way(normal: np.ndarray) -> np.ndarray:
    """(n,) which of `WAYS` directions modulo half a turn some normals (n, 2) have."""
    return np.round(np.arctan2(normal[:, 1], normal[:, 0]) / (np.pi / WAYS)).astype(int) % WAYS
