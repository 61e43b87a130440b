"""The geometry channel: borders between parts as a model predicts them, searched in a picture along their normals.

Which part a pixel shows does not depend on colour or light, so predicted borders hold in any look. What is found is a
displacement along the normal alone (Harris and Stennett, "RAPID - a video rate object tracker", BMVC 1990; Comport,
Marchand, Pressigout and Chaumette, IEEE TVCG 12(4), 2006).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from vispeg.vision.geometry import Geometry
from vispeg.vision.predict import Rendering

HALVINGS = 7  # of the step of 1 px between two pixels: a border is located to 1/128 px
# px, radius of the neighbourhood that gives the direction of a border: a smaller one would bend with it at corners
REACH = 6.0
STRAIGHT = 0.25  # px RMS off a line beyond which the neighbourhood contains a corner, so that it has no direction
FREE = 12.0  # px, distance along a normal within which other borders are searched
CREASE = 3.0  # px from a border within which an edge of the picture may come from a crease of one of its surfaces
APART = 0.25  # px between the rays that look for a crease
BEND = 0.3  # least change of a surface's slope, in m of depth per m across, that counts as a crease
SMOOTH = 0.05  # largest bend beyond a crease, as a share of the bend at it; a rounded surface bends more


@dataclass(frozen=True, eq=False)
class Borders:
    """Points on the borders of one predicted picture, (n, ...); a world's projection moves them without drawing again.

    Attributes:
        pixel: (n, 2) px.
        normal: (n, 2) of unit length, from the nearer surface to the farther.
        parts: (n, 2) the part on the near side and that on the far side, counted as `Rendering.parts`.
        depth: (n,) m of the near surface, along the optical axis.
        body: (n,) id of the body that carries the near surface.
        local: (n, 3) the point in that body's axes, m.
        free: (n, 2) px to the next border against the normal and along it, `FREE` at most.
    """

    pixel: np.ndarray
    normal: np.ndarray
    parts: np.ndarray
    depth: np.ndarray
    body: np.ndarray
    local: np.ndarray
    free: np.ndarray

    def __len__(self) -> int:
        return len(self.pixel)

    def some(self, rows: np.ndarray) -> Borders:
        """Select points by indices or by a mask (n,) bool."""
        return Borders(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def moved(self, geometry: Geometry, camera: str) -> np.ndarray:
        """Return the displacement (n,) px of the points along their normals in the geometry's world and posture."""
        return np.einsum("ni,ni->n", geometry.project(camera, self.body, self.local) - self.pixel, self.normal)


def borders_of(rendering: Rendering, geometry: Geometry, step: float = 2.0, margin: float = 4.0) -> Borders:
    """Return the borders of a predicted picture, to a hundredth of a pixel by casting rays.

    Args:
        rendering: the picture.
        geometry: in the world and posture that it was drawn in.
        step: approximate distance between two points of a border, px.
        margin: width of the frame at the edge of the image that has no points, px.
    """
    name = rendering.eye.believed.name
    inner, outer = _crossings(rendering.parts)
    height, width = rendering.parts.shape
    mid = (inner + outer) / 2
    inside = np.minimum(mid, (width - 1, height - 1) - mid).min(axis=1) > margin
    inner, outer = inner[inside], outer[inside]
    sides = _bisected(geometry, name, inner, outer)
    if sides is None:
        return _none()
    at, pairs, toward, depth, geom = sides
    normal, straight = _normals(at, pairs, toward)
    keep = np.flatnonzero(straight)[_thinned(at[straight], pairs[straight], step)]
    keep = keep[~_creased(geometry, name, at[keep], normal[keep])]
    at, pairs, normal, depth, geom = (x[keep] for x in (at, pairs, normal, depth, geom))
    body, local = geometry.local(name, at, depth, geom)
    return Borders(at, normal, pairs, depth, body, local, _free(rendering.parts, at, normal))


def _none() -> Borders:
    """Return no points."""
    flat, pair, place = np.zeros((0, 2)), np.zeros((0, 2), np.int64), np.zeros((0, 3))
    return Borders(flat, flat, pair, np.zeros(0), np.zeros(0, np.int64), place, flat)


def _crossings(parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the centres of two neighbouring pixels that show different parts, each (n, 2) px, right and down."""
    right, down = np.nonzero(parts[:, 1:] != parts[:, :-1]), np.nonzero(parts[1:] != parts[:-1])
    first = np.concatenate([np.stack(right[::-1], 1), np.stack(down[::-1], 1)]).astype(float)
    step = np.concatenate([np.tile([1.0, 0.0], (len(right[0]), 1)), np.tile([0.0, 1.0], (len(down[0]), 1))])
    return first, first + step


def _bisected(geometry: Geometry, name: str, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, ...] | None:
    """Find where between pixels a and b (n, 2) the part changes, by bisection with rays.

    Returns:
        Points (m, 2) px on the near side of the border, parts (m, 2) near and far, direction (m, 2) to the far side,
        depth (m,) m and geom (m,) of the near side; None if there is no border at all.
    """
    if not len(a):
        return None
    a, b = a.copy(), b.copy()
    ends = [geometry.cast(name, a), geometry.cast(name, b)]
    differs = ends[0][2] != ends[1][2]
    a, b = a[differs], b[differs]
    first, second = ([x[differs] for x in end] for end in ends)
    for _ in range(HALVINGS):
        middle = (a + b) / 2
        now = geometry.cast(name, middle)
        same = now[2] == first[2]
        a[same], b[~same] = middle[same], middle[~same]
        for old, new in zip(first, now, strict=True):
            old[same] = new[same]
        for old, new in zip(second, now, strict=True):
            old[~same] = new[~same]
    hit = (first[0] > 0) | (second[0] > 0)
    depths = [np.where(end[0] > 0, end[0], np.inf) for end in (first, second)]
    near = depths[0] <= depths[1]  # the first is the nearer
    at = np.where(near[:, None], a, b)
    pairs = np.stack([np.where(near, first[2], second[2]), np.where(near, second[2], first[2])], 1)
    toward = np.where(near[:, None], b - a, a - b)
    toward = toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-12)
    depth, geom = (np.where(near, first[k], second[k]) for k in (0, 1))
    return tuple(x[hit] for x in (at, pairs, toward, depth, geom)) if hit.any() else None


def _normals(at: np.ndarray, pairs: np.ndarray, toward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normals (n, 2) of borders through points, and whether each border is straight there, (n,) bool.

    The normal is the direction of least spread of the neighbours between the same parts, on the side of `toward`.

    Args:
        at, pairs, toward: points, parts and direction to the far side, as `_bisected` returns them.
    """
    kind = np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1, 1)
    tree = cKDTree(np.concatenate([at, 100.0 * REACH * kind], 1))  # other parts are out of reach in the third axis
    i, j = tree.query_pairs(REACH, output_type="ndarray").T
    i, j = np.concatenate([i, j]), np.concatenate([j, i])
    count = np.bincount(i, minlength=len(at)) + 1
    mean = at + np.stack([np.bincount(i, (at[j] - at[i])[:, k], len(at)) for k in (0, 1)], 1) / count[:, None]
    spread = np.zeros((len(at), 2, 2))
    for rows, others in ((i, j), (np.arange(len(at)),) * 2):  # neighbours, and each point itself
        off = at[others] - mean[rows]
        np.add.at(spread, rows, off[:, :, None] * off[:, None, :])
    values, vectors = np.linalg.eigh(spread / count[:, None, None])
    normal = vectors[:, :, 0]
    sign = np.sign(np.einsum("ni,ni->n", normal, toward))
    straight = (count >= 4) & (np.sqrt(np.maximum(values[:, 0], 0)) < STRAIGHT) & (values[:, 1] > 4 * values[:, 0])
    return normal * np.where(sign == 0, 1.0, sign)[:, None], straight & (sign != 0)


def _thinned(at: np.ndarray, pairs: np.ndarray, step: float) -> np.ndarray:
    """Return the index of one point for each cell of `step` px and pair of parts: the one nearest to its middle."""
    if not len(at):
        return np.zeros(0, np.int64)
    cell = np.floor(at / step)
    off = np.linalg.norm(at - (cell + 0.5) * step, axis=1)
    order = np.argsort(off, kind="stable")
    first = np.unique(np.concatenate([cell, pairs], 1)[order], axis=0, return_index=True)[1]
    return np.sort(order[first])


def _creased(geometry: Geometry, name: str, at: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return whether the surface on either side of a border has a crease beside points (n, 2) px, (n,) bool.

    A crease looks like the border, so an edge found there may be the wrong one. The inverse of depth is linear in the
    picture along a plane, so it bends only at a crease. A rounded surface bends all the way from its border and has no
    edge of its own.
    """
    if not len(at):
        return np.zeros(0, bool)
    distance = np.arange(2.0 * APART, CREASE + 3.0 * APART, APART)
    focal, out = geometry.eyes[name].camera.fx, np.zeros(len(at), bool)
    for side in (-1.0, 1.0):
        places = at[:, None] + side * distance[:, None] * normal[:, None]
        depth, _, part = (x.reshape(len(at), -1) for x in geometry.cast(name, places.reshape(-1, 2)))
        inverse = np.where(depth > 0, 1.0 / np.maximum(depth, 1e-9), 0.0)
        bend = np.abs(np.diff(inverse, 2, axis=1)) * focal / (APART * np.maximum(inverse[:, 1:-1], 1e-9))
        one_part = np.all(part == part[:, :1], axis=1) & (inverse > 0).all(axis=1)
        rows, top = np.arange(len(at)), bend.argmax(axis=1)
        beyond = np.where(np.arange(bend.shape[1]) > top[:, None] + 1, bend, 0.0).max(axis=1)
        sharp = (bend[rows, top] > BEND) & (beyond < SMOOTH * bend[rows, top]) & (top < bend.shape[1] - 2)
        out |= one_part & sharp
    return out


def _free(parts: np.ndarray, at: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the distance (n, 2) px to the next border against the normal and along it, `FREE` at most."""
    height, width = parts.shape
    steps = np.arange(1.0, FREE + 0.5, 0.5)
    out = np.full((len(at), 2), FREE)
    for k, sign in enumerate((-1.0, 1.0)):
        places = at[:, None] + sign * steps[:, None] * normal[:, None]
        u = np.clip(np.rint(places[..., 0]).astype(int), 0, width - 1)
        v = np.clip(np.rint(places[..., 1]).astype(int), 0, height - 1)
        labels = parts[v, u]
        other = labels != labels[:, :1]
        out[:, k] = np.where(other.any(1), steps[other.argmax(1)], FREE)
    return out
