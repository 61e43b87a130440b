"""Tells whether pictures show the moment that their labels state: depth is laid on the surfaces that are labelled."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from vispeg.core.seeds import stream
from vispeg.datasets.formats.models import Mesh
from vispeg.render.cameras.camera import Camera

POINTS = 4000  # of a surface: on a part of 0.1 m they lie about 2 mm apart, and the distance is taken along the normal
PIXELS = 400  # of a picture, drawn at random: the median of so many is known to a twentieth of their scatter
FEWEST = 20  # pixels of a part, below which a picture tells nothing
NEAR = 0.02  # m: a point further from the surface is of something else
LEAST = 1e-3  # m by which labels must be off: errors of usual depth sensors change by less from one picture to the next
SPREADS = 4.0  # of the distances' own spread (its normal sd) that a picture must be off by


@dataclass(frozen=True)
class Seen:
    """A part in the pictures of one camera in one episode, as labels state it.

    Attributes:
        camera: as drawn.
        part: its name.
        depth: (T, H, W) m, 0 = no reading.
        mask: (T, H, W) bool, which pixels show the part; None where no label says so: those whose points lie near it.
        at: (T, 4, 4) the part's pose in camera axes, m.
        mesh: its surface in the frame of that pose, m.
    """

    camera: Camera
    part: str
    depth: np.ndarray
    mask: np.ndarray | None
    at: np.ndarray
    mesh: Mesh


def disagreements(things: Iterable[Seen]) -> Iterator[str]:
    """Yield a line for each camera and part of which pictures show another moment than their labels state."""
    for seen in things:
        pictures, own, before = late(seen)
        if len(pictures):
            yield (
                f"{seen.camera.name} shows the {seen.part} where the labels of the frame before put it, not its own, "
                f"in {len(pictures)} of {len(seen.depth)} frames from {pictures[0]} on (depth is {1e3 * own:.1f} mm "
                f"off; {1e3 * before:.1f} mm with the labels before)"
            )


def late(seen: Seen) -> tuple[np.ndarray, float, float]:
    """Pictures of an episode whose depth fits the labels of the picture before, not their own.

    A sensor's own error changes slowly: what counts is how far a picture is from the median over the episode.

    Returns:
        Indices of those pictures, and the median distance in m to the surface of their points by their own labels and
        by those of the picture before.
    """
    from scipy.spatial import cKDTree

    surface, normals = sampled(seen.mesh)
    tree, rays, depth = cKDTree(surface), seen.camera.rays().reshape(-1, 3), seen.depth
    rng = stream(0, "moments")

    def distance(t: int, label: int) -> float:
        """Take the median signed distance, m, of picture t's points to the part by the labels of picture `label`."""
        read = np.isfinite(depth[t]) & (depth[t] > 0)
        rows = np.flatnonzero(read if seen.mask is None else read & seen.mask[label])
        if len(rows) > PIXELS:
            rows = rng.choice(rows, PIXELS, replace=False)
        points = rays[rows] * depth[t].reshape(-1)[rows, None].astype(float)
        points = (points - seen.at[label, :3, 3]) @ seen.at[label, :3, :3]
        away, nearest = tree.query(points, distance_upper_bound=NEAR)
        close = np.isfinite(away)
        if close.sum() < FEWEST:
            return np.nan
        i = nearest[close]
        return float(np.median(np.einsum("ij,ij->i", points[close] - surface[i], normals[i])))

    own = np.array([distance(t, t) for t in range(1, len(depth))])
    before = np.array([distance(t, t - 1) for t in range(1, len(depth))])
    if np.isfinite(own).sum() < 3 or np.isfinite(before).sum() < 3:
        return np.empty(0, int), np.nan, np.nan
    middle, spread = min((_spread(d) for d in (own, before)), key=lambda s: s[1])
    off, off_before = np.abs(own - middle), np.abs(before - middle)
    wrong = np.flatnonzero((off > LEAST + SPREADS * spread) & (off_before < 0.5 * off))
    if not len(wrong):
        return wrong, np.nan, np.nan
    return wrong + 1, float(np.median(off[wrong])), float(np.median(off_before[wrong]))


def _spread(values: np.ndarray) -> tuple[float, float]:
    """Return median and scaled median absolute deviation (1 standard deviation if normal) of the finite values."""
    values = values[np.isfinite(values)]
    middle = float(np.median(values))
    return middle, 1.4826 * float(np.median(np.abs(values - middle)))


def sampled(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) spread over a surface and its normals (n, 3) there."""
    import trimesh

    solid = trimesh.Trimesh(*mesh, process=False)
    drawn = trimesh.sample.sample_surface(solid, POINTS, seed=0)  # points, their faces, and colours only if asked for
    return np.asarray(drawn[0]), np.asarray(solid.face_normals)[drawn[1]]
