"""Find a camera far from its nominal pose, or delayed, by the distance of predicted borders to edges.

Each picture is turned into distance fields, one per edge direction. The score of a world is the mean distance at its
borders, capped at a reach that shrinks. No border has to be matched to a particular edge, and no trial needs a
render. Poses on a grid and delays are scored; the best are refined, and their borders are rendered again (chamfer
matching: Barrow, Tenenbaum, Bolles and Wolf, IJCAI 1977; coarse to fine: Borgefors, IEEE TPAMI 10(6), 1988).
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
REACHES = (40.0, 20.0, 10.0)  # px, cap of the distance to an edge, stage by stage
REFINED = (8, 3, 1)  # number of trials refined at each reach
STEPS, FINITE = 6, 0.05  # Gauss-Newton steps; finite difference in typical sizes, a large part of a pixel at a border
WAYS, ALIKE = 4, np.radians(35)  # number of edge directions; largest angle between edges of one direction
EDGES = 0.08  # share of the pixels taken as edges: those with the steepest gradient
FRAMES, SPARSE = 6, 120  # number of frames used, and of border points in each
DEEP, FAR = 0.03, 5.0  # least relative change of depth per pixel at an edge; m, depth of pixels without a reading
LOOSE = 25.0  # width of the weak prior on a camera's offset, in typical sizes


@dataclass(frozen=True, eq=False)
class Outline:
    """Border points of a camera in a few frames, and the distance fields of these frames, (frames, WAYS, H, W) px."""

    sight: Sight
    points: Points
    fields: np.ndarray

    def distances(self, geometry: Geometry, world: World, reach: float) -> np.ndarray:
        """Return (n,) px from the points in a world to the nearest edges of their direction, at most `reach`.

        A point outside the picture, or behind the camera, counts as `reach` away.
        """
        p = self.points
        u, v = np.nan_to_num(pixels(geometry, self.sight, world, p), nan=-1.0).T
        height, width = self.fields.shape[2:]
        inside = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
        u, v = np.clip(u, 0, width - 1.001), np.clip(v, 0, height - 1.001)
        i, j = v.astype(int), u.astype(int)
        a, b = v - i, u - j  # weights of bilinear interpolation
        f, k, way = self.fields, p.frame, _way(p.normal)
        upper = (1 - b) * f[k, way, i, j] + b * f[k, way, i, j + 1]
        lower = (1 - b) * f[k, way, i + 1, j] + b * f[k, way, i + 1, j + 1]
        return np.where(inside, np.minimum((1 - a) * upper + a * lower, reach), reach)


def brought_near(predictor: Predictor, sights: Sequence[Sight], world: World) -> list[World]:
    """Search the delays, and separately the poses, of all cameras; return the best world of each of the two searches.

    Args:
        predictor: of the cell.
        sights: of one or more cameras.
        world: has a `camera_offset` and a `camera_delay` of each camera.
    """
    out = []
    for trials_of in (_delayed, _moved):
        near = world
        for camera in dict.fromkeys(s.camera.name for s in sights):
            sight = next(s for s in sights if s.camera.name == camera)
            rows = np.linspace(0, len(sight) - 1, min(FRAMES, len(sight))).round().astype(int)
            near = _near(predictor, sight.only(rows), near, list(trials_of(near, camera)))
        out.append(near)
    return out


def _near(predictor: Predictor, sight: Sight, world: World, trials: Sequence[World]) -> World:
    """Return the best trial after refinement.

    It is `world` if the frames have neither depth nor colour, or the camera is predicted to see no border.
    """
    fields = _all_fields(sight)
    if fields is None:
        return world
    outline = _outline(predictor, sight, world, fields)
    if not len(outline.points.frame):
        return world
    for reach, count in zip(REACHES, REFINED, strict=True):
        score = [float(outline.distances(predictor.geometry, w, reach).mean()) for w in trials]
        best = [trials[i] for i in np.argsort(score)[:count]]
        outlines = [_outline(predictor, sight, w, fields) for w in best]
        pairs = [(o, w) for o, w in zip(outlines, best, strict=True) if len(o.points.frame)]
        if not pairs:
            return world
        refined = [_refined(predictor.geometry, o, w, reach) for o, w in pairs]
        trials = [w for w, _ in sorted(refined, key=lambda r: r[1])]
        outline = _outline(predictor, sight, trials[0], fields)
    return trials[0]


def _outline(predictor: Predictor, sight: Sight, world: World, fields: np.ndarray) -> Outline:
    """Render the borders of a world, and keep `SPARSE` points of each frame at random."""
    points = outlined(predictor, sight, world)
    rng = np.random.default_rng(0)
    chosen = [rng.permutation(np.flatnonzero(points.frame == k))[:SPARSE] for k in range(len(sight))]
    return Outline(sight, points.only(np.sort(np.concatenate(chosen))), fields)


def _delayed(world: World, camera: str) -> Iterator[World]:
    """Yield the world with each of `DELAYS` for a camera."""
    for delay in DELAYS:
        yield _with(world, camera, "camera_delay", delay=float(delay))


def _moved(world: World, camera: str) -> Iterator[World]:
    """Yield the world with each offset of a camera on the grid of `TURNS` and `SHIFTS`."""
    for rx, ry, x, y in product(TURNS, TURNS, SHIFTS, SHIFTS):
        yield _with(world, camera, "camera_offset", rx=float(rx), ry=float(ry), x=float(x), y=float(y))


def _with(world: World, camera: str, name: str, **values: float) -> World:
    changed = (e.with_values(**values) if (e.effect, e.where) == (name, camera) else e for e in world.effects)
    return replace(world, effects=tuple(changed))


def _refined(geometry: Geometry, outline: Outline, world: World, reach: float) -> tuple[World, float]:
    """Return the world after Gauss-Newton steps of the camera's offset and delay, and its score."""
    names = ("camera_offset", "camera_delay")
    camera = outline.sight.camera.name
    space = Space(world, [i for i, e in enumerate(world.effects) if e.effect in names and e.where == camera])
    (low, high), u = space.bounds, space.start
    r = outline.distances(geometry, space.at(u), reach)
    for _ in range(STEPS):
        near = r < reach
        if near.sum() < 10 * len(u):  # too few points for this many parameters
            break
        steps = FINITE * np.sign(space.steps(u))
        moved = [
            outline.distances(geometry, space.at(u + h * a), reach) for h, a in zip(steps, np.eye(len(u)), strict=True)
        ]
        jac = np.stack([(m - r)[near] / h for m, h in zip(moved, steps, strict=True)], 1)
        scale = max(float(np.median(r[near])), 0.5)  # px, taken as the standard deviation of the distances
        step = np.linalg.solve(jac.T @ jac / scale**2 + np.eye(len(u)) / LOOSE**2, -jac.T @ r[near] / scale**2)
        for shorter in (1.0, 0.5, 0.25):
            shifted = np.clip(u + shorter * step, low, high)
            away = outline.distances(geometry, space.at(shifted), reach)
            if away.mean() < r.mean():
                break
        else:
            break
        u, r = shifted, away
    return space.at(u), float(r.mean())


def _all_fields(sight: Sight) -> np.ndarray | None:
    """Return the distance fields of a sight, (frames, WAYS, H, W), or None.

    They are of depth steps if all frames have depth, otherwise of colour edges; None if there is neither.
    """
    depths = [sight.depth(i) for i in range(len(sight))]
    if all(d is not None for d in depths):
        return np.stack([_fields(_log(d)[..., None], DEEP) for d in depths if d is not None])
    pictures = [sight.rgb(i) for i in range(len(sight))]
    present = [p for p in pictures if p is not None]
    return np.stack([_fields(p, 0.0) for p in present]) if len(present) == len(pictures) else None


def _log(depth: np.ndarray) -> np.ndarray:
    """Return the logarithm of a depth picture, (H, W), small gaps closed; pixels without a reading count as far."""
    import cv2

    return np.log(cv2.medianBlur(np.where(depth > 0, depth, FAR).astype(np.float32), 5))


def _fields(picture: np.ndarray, least: float) -> np.ndarray:
    """Return (WAYS, H, W) float32 px to the nearest edge of each direction, at most `REACHES[0]`.

    Args:
        picture: (H, W, C).
        least: smallest step that counts as an edge.
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
    """Return for each normal, (n, 2), the index (n,) of its direction among `WAYS`, modulo half a turn."""
    return np.round(np.arctan2(normal[:, 1], normal[:, 0]) / (np.pi / WAYS)).astype(int) % WAYS
