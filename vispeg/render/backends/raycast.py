"""Pictures by casting a ray through each pixel's centre: no graphics driver needed, and the oracle for those that do.

Depth, normals and ids are exact. Colour is plain: Lambert's law with the model's lights, material and texture colours,
no shadows, no highlights.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from vispeg.render.backends.picture import HIDDEN, Picture, is_visible
from vispeg.render.backends.shading import shade
from vispeg.render.cameras.view import NEAR, REACH, View

SEEN = np.array([1, 1, 1, 0, 0, 0], np.uint8)


class Raycast:
    """Draws by ray casting; arguments as for `Classic`, of which size and shadows do not matter here."""

    name = "raycast"
    remembers = False

    def __init__(self, model: mujoco.MjModel, width: int = 0, height: int = 0, shadows: bool = False):
        self.model = model

    def draw(self, data: mujoco.MjData, views: Sequence[View], ids: bool) -> list[Picture]:
        """One picture a view, in order; `data` has its kinematics and lights done."""
        return [self._one(data, view) for view in views]

    def upload(self, texture: int) -> None:
        """Nothing: pixels are read from the model."""

    def close(self) -> None:
        """Nothing: no driver memory is held."""

    def _one(self, data: mujoco.MjData, view: View) -> Picture:
        depth, geom_ids, normals = cast(self.model, data, view)
        rays = view.camera.rays()
        points = view.pos + (rays * depth[..., None]) @ view.rot.T
        rgb = shade(self.model, data, geom_ids, points, normals, view)
        return Picture(rgb, depth.astype(np.float32), geom_ids, (normals @ view.rot).astype(np.float32))


def cast(model: mujoco.MjModel, data: mujoco.MjData, view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cast rays through the pixel centres, with lens distortion; return the first hits.

    Returns:
        Planar depth (H, W) in m, 0 where nothing is; geom ids (H, W) int32, -1 there; outward normals (H, W, 3) in the
        world frame, 0 there.
    """
    rays = view.camera.rays()
    shape, length = rays.shape[:2], np.linalg.norm(rays, axis=-1)
    directions = ((rays / length[..., None]) @ view.rot.T).reshape(-1, 3)
    depth, geom_ids, normals = cast_rays(model, data, view.pos, directions, length.ravel())
    return depth.reshape(shape), geom_ids.reshape(shape), normals.reshape(*shape, 3)


def cast_rays(
    model: mujoco.MjModel, data: mujoco.MjData, pos: np.ndarray, directions: np.ndarray, length: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cast rays from one point; return the first hits on visible geoms.

    Args:
        model, data: with kinematics done.
        pos: (3,) where the rays begin, world frame, m.
        directions: (n, 3) of unit length, world frame.
        length: (n,) what divides a distance to give planar depth: the length of the ray that has z = 1.

    Returns:
        Depth (n,) in m, 0 where nothing is; geom ids (n,) int32, -1 there; outward normals (n, 3), world frame.
    """
    n = len(directions)
    ids, distance, normals = np.empty((n, 1), np.int32), np.empty((n, 1)), np.zeros((3 * n, 1))
    start, unit = np.array(pos, float).reshape(3, 1), np.ascontiguousarray(directions).reshape(-1, 1)
    groups = model.geom_group.copy()
    model.geom_group[~is_visible(model)] = HIDDEN
    try:
        mujoco.mj_multiRay(model, data, start, unit, SEEN[:, None], True, -1, ids, distance, normals, n, 20 * REACH)
    finally:
        model.geom_group[:] = groups
    depth = distance[:, 0] / length
    none = (distance[:, 0] < 0) | (depth < NEAR) | (depth > REACH)
    geom_ids, normals = ids[:, 0], normals.reshape(n, 3)
    depth[none], geom_ids[none], normals[none] = 0, -1, 0
    return depth, geom_ids, normals
