"""Test whether pictures show the moment of their labels, by the distance of depth points to labelled surfaces."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from vispeg.core.robust import spread
from vispeg.core.seeds import stream
from vispeg.datasets.formats.models import Mesh
from vispeg.render.cameras.camera import Camera

POINTS = 4000  # points that represent a part's surface: about 2 mm apart on a part of 0.1 m
PIXELS = 400  # most depth points of a picture that are compared; their median errs by a sixteenth of their scatter
FEWEST = 20  # fewest points near a part's surface from which a distance is taken
NEAR = 0.02  # m; a point farther from the surface belongs to something else
LEAST = 1e-3  # m; errors of usual depth sensors change by less, so a late picture's error must exceed it
SPREADS = 4.0  # plus this many standard deviations of the distances
# If the distances to the previous labels scatter by less than this share of those to a picture's own labels, the
# previous labels are the right ones. Of two samples of 20 normal numbers with equal scatter, 3 in 1,000 differ so.
CLEARER = 1 / 3


@dataclass(frozen=True)
class Seen:
    """A part in the pictures of one camera in one episode, according to the labels.

    Attributes:
        camera: the camera as drawn for the episode.
        part: name of the part.
        depth: (T, H, W) m, 0 = no reading.
        mask: (T, H, W) bool, pixels that show the part; None without labels: then points near the surface are used.
        at: (T, 4, 4) pose of the part in camera axes, m.
        mesh: surface of the part in the frame of that pose, m.
    """

    camera: Camera
    part: str
    depth: np.ndarray
    mask: np.ndarray | None
    at: np.ndarray
    mesh: Mesh


def disagreements(things: Iterable[Seen]) -> Iterator[str]:
    """Yield a line for each camera and part whose pictures fit the labels of the previous picture."""
    for seen in things:
        pictures, own, before = late(seen)
        if len(pictures):
            yield (
                f"{seen.camera.name} shows the {seen.part} where the labels of the previous frame put it, not its own, "
                f"in {len(pictures)} of {len(seen.depth)} frames from {pictures[0]} on (depth is {1e3 * own:.1f} mm "
                f"off; {1e3 * before:.1f} mm with the previous labels)"
            )


def late(seen: Seen) -> tuple[np.ndarray, float, float]:
    """Find pictures of an episode whose depth fits the labels of the previous picture, not their own.

    A sensor's error changes slowly, so a picture's distance is compared with the median over the episode. Pictures that
    are all late while the part moves at constant speed look like that error, and are not found.

    Returns:
        Indices (n,) of those pictures, and the medians of their errors, m, with their own and with the previous labels;
        NaN if there are none.
    """
    from scipy.spatial import cKDTree

    surface, normals = sampled(seen.mesh)
    tree, rays, depth = cKDTree(surface), seen.camera.rays().reshape(-1, 3), seen.depth
    low, high = surface.min(axis=0) - NEAR, surface.max(axis=0) + NEAR
    rng = stream(0, "moments")

    def distance(t: int, label: int) -> float:
        """Return the median signed distance, m, of picture t's points from the part as labelled in picture `label`."""
        read = np.isfinite(depth[t]) & (depth[t] > 0)
        rows = np.flatnonzero(read if seen.mask is None else read & seen.mask[label])
        points = rays[rows] * depth[t].reshape(-1)[rows, None].astype(float)
        points = (points - seen.at[label, :3, 3]) @ seen.at[label, :3, :3]  # from camera axes into the mesh's frame
        points = points[np.all((points > low) & (points < high), axis=1)]
        if len(points) > PIXELS:
            points = rng.choice(points, PIXELS, replace=False)
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
    # The sensor's constant error and its noise are taken from the labels that are right for most pictures. With the
    # others the distances scatter more, since they contain the part's motion between two pictures.
    (middle, scatter), (other, scatter_before) = _spread(own), _spread(before)
    if scatter_before < CLEARER * scatter:
        middle, scatter = other, scatter_before
    off, off_before = np.abs(own - middle), np.abs(before - middle)
    wrong = np.flatnonzero((off > LEAST + SPREADS * scatter) & (off_before < 0.5 * off))
    if not len(wrong):
        return wrong, np.nan, np.nan
    return wrong + 1, float(np.median(off[wrong])), float(np.median(off_before[wrong]))


def _spread(values: np.ndarray) -> tuple[float, float]:
    """Return median and scaled median absolute deviation (1 standard deviation if normal) of the finite values."""
    values = values[np.isfinite(values)]
    return float(np.median(values)), spread(values)


def sampled(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return points (n, 3) sampled from a surface, and the normals (n, 3) there."""
    import trimesh

    solid = trimesh.Trimesh(*mesh, process=False)
    drawn = trimesh.sample.sample_surface(solid, POINTS, seed=0)  # points and their faces
    return np.asarray(drawn[0]), np.asarray(solid.face_normals)[drawn[1]]
