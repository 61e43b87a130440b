"""Exact labels of rendered images: parts, surface normals and poses of objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.view import View

Parts = Mapping[str, Sequence[str]]


def part_table(model: mujoco.MjModel, parts: Parts | None) -> np.ndarray:
    """Return a table (ngeom + 1,) int32 from geom ids to labels; its last entry, for id -1 (no hit), is 0.

    Labels number the parts from 1, in the order of `parts`; a geom that is in no part gets 0. Without parts, the label
    of a geom is its id + 1.

    Raises:
        UserError: a part names a geom that the model does not have.
    """
    if parts is None:
        return np.append(np.arange(1, model.ngeom + 1), 0).astype(np.int32)
    table = np.zeros(model.ngeom + 1, np.int32)
    for number, (part, geoms) in enumerate(parts.items(), start=1):
        for name in geoms:
            geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
            if geom < 0:
                raise UserError("no such geom", key=f"parts.{part}", got=name)
            table[geom] = number
    return table


def normals_of(depth: np.ndarray, camera: Camera) -> np.ndarray:
    """Return surface normals (H, W, 3) float32 of a depth image (H, W) in m, in camera axes, facing the camera.

    A normal is the cross product of the steps to a neighbour in the column and to one in the row, each on the side
    where depth changes less, so that edges stay sharp. It is 0 where no neighbour has a reading.
    """
    points = camera.points(depth)
    across, down = _step(points, depth, 1), _step(points, depth, 0)
    normal = np.cross(down, across)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0).astype(np.float32)


def _step(points: np.ndarray, depth: np.ndarray, axis: int) -> np.ndarray:
    """Return the step (H, W, 3) to the neighbour along an axis, on the side where depth changes less; 0 if none."""
    points, depth = np.moveaxis(points, axis, 0), np.moveaxis(depth, axis, 0)
    jump = np.where((depth[1:] > 0) & (depth[:-1] > 0), np.abs(np.diff(depth, axis=0)), np.inf)
    edge = np.full((1, *jump.shape[1:]), np.inf)
    ahead, behind = np.concatenate([jump, edge]), np.concatenate([edge, jump])
    steps = np.diff(points, axis=0)
    none = np.zeros((1, *steps.shape[1:]))
    step = np.where((ahead <= behind)[..., None], np.concatenate([steps, none]), np.concatenate([none, steps]))
    step[~np.isfinite(np.minimum(ahead, behind))] = 0
    return np.moveaxis(step, 0, axis)


def poses(
    model: mujoco.MjModel, data: mujoco.MjData, view: View, sites: Sequence[str], bodies: Sequence[str]
) -> dict[str, np.ndarray]:
    """Return by name the poses (4, 4), in m and camera axes, of those of these sites and bodies that the model has.

    The kinematics of `data` must be computed.
    """
    out = {}
    kinds = ((sites, mujoco.mjtObj.mjOBJ_SITE, data.site_xpos, data.site_xmat),)
    kinds += ((bodies, mujoco.mjtObj.mjOBJ_BODY, data.xpos, data.xmat),)
    for names, kind, pos, axes in kinds:
        for name in names:
            i = mujoco.mj_name2id(model, kind, name)
            if i >= 0:
                out[name] = np.eye(4)
                out[name][:3, :3] = view.rot.T @ axes[i].reshape(3, 3)
                out[name][:3, 3] = view.rot.T @ (pos[i] - view.pos)
    return out
