"""Rendering by a ray through the centre of each pixel.

It needs no graphics driver, and tests compare the other backends with it. Depth, normals and ids are exact. Colour is
plain: Lambert's law with the model's lights, materials and textures, without shadows or highlights.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from vispeg.render.backends.picture import HIDDEN, Picture, is_visible
from vispeg.render.backends.shading import shade
from vispeg.render.cameras.view import NEAR, REACH, View

SEEN = np.array([1, 1, 1, 0, 0, 0], np.uint8)  # which geom groups the rays hit


class Raycast:
    """The ray casting backend."""

    name = "raycast"
    remembers = False

    def __init__(self, model: mujoco.MjModel):
        self.model = model

    def draw(self, data: mujoco.MjData, views: Sequence[View], ids: bool) -> list[Picture]:
        """Return one picture per view, in order; the kinematics and lights of `data` must be computed."""
        return [self._draw_view(data, view) for view in views]

    def upload(self, texture: int) -> None:
        """Do nothing: texture pixels are read from the model in each draw."""

    def close(self) -> None:
        """Do nothing: no driver memory is held."""

    def _draw_view(self, data: mujoco.MjData, view: View) -> Picture:
        depth, geom_ids, normals = cast(self.model, data, view)
        rays = view.camera.rays()
        points = view.pos + (rays * depth[..., None]) @ view.rot.T
        rgb = shade(self.model, data, geom_ids, points, normals, view)
        return Picture(rgb, depth.astype(np.float32), geom_ids, (normals @ view.rot).astype(np.float32))


def cast(model: mujoco.MjModel, data: mujoco.MjData, view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cast rays through the pixel centres, with lens distortion, and return the first hits.

    Returns:
        Depth (H, W) along the optical axis in m, 0 for no hit; geom ids (H, W) int32, -1 for no hit; outward normals
        (H, W, 3) in the world frame, 0 for no hit.
    """
    rays = view.camera.rays()
    shape, length = rays.shape[:2], np.linalg.norm(rays, axis=-1)
    directions = ((rays / length[..., None]) @ view.rot.T).reshape(-1, 3)
    depth, geom_ids, normals = cast_rays(model, data, view.pos, directions, length.ravel())
    return depth.reshape(shape), geom_ids.reshape(shape), normals.reshape(*shape, 3)


def cast_rays(
    model: mujoco.MjModel, data: mujoco.MjData, pos: np.ndarray, directions: np.ndarray, length: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cast rays from one point and return the first hits on visible geoms, between depths NEAR and REACH.

    Args:
        model, data: the model and its state, with computed kinematics.
        pos: (3,) start of the rays, world frame, m.
        directions: (n, 3) directions of unit length, world frame.
        length: (n,) length of each ray when scaled to z = 1 in camera axes; distance / length is the planar depth.

    Returns:
        Planar depth (n,) in m, 0 for no hit; geom ids (n,) int32, -1 for no hit; outward normals (n, 3) in the world
        frame, 0 for no hit.
    """
    n = len(directions)
    ids, distance, normals = np.empty((n, 1), np.int32), np.empty((n, 1)), np.zeros((3 * n, 1))
    start, unit = np.array(pos, float).reshape(3, 1), np.ascontiguousarray(directions).reshape(-1, 1)
    farthest = REACH * float(np.max(length, initial=1.0))  # at which a ray is still at a depth of REACH
    groups = model.geom_group.copy()
    model.geom_group[~is_visible(model)] = HIDDEN
    try:
        mujoco.mj_multiRay(model, data, start, unit, SEEN[:, None], True, -1, ids, distance, normals, n, farthest)
    finally:
        model.geom_group[:] = groups
    depth = distance[:, 0] / length
    none = (distance[:, 0] < 0) | (depth < NEAR) | (depth > REACH)
    geom_ids, normals = ids[:, 0], normals.reshape(n, 3)
    depth[none], geom_ids[none], normals[none] = 0, -1, 0
    return depth, geom_ids, normals
