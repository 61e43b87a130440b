"""What a picture shows, known exactly: parts, surface normals, poses of objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.view import View

Parts = Mapping[str, Sequence[str]]


def part_table(model: mujoco.MjModel, parts: Parts | None) -> np.ndarray:
    """(ngeom + 1,) int32: the label of each geom id, the last entry (id -1) 0 for nothing.

    Parts count from 1 in the order of `parts`; geoms in none of them are 0 too. Without parts a label is id + 1.

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
    """(H, W, 3) float32 normals in camera axes, towards the camera, of a depth picture (H, W) in m; 0 where none.

    Each is the cross product of the steps to a neighbour in the row and one in the column, on the side where depth
    changes less, so that edges do not smear.
    """
    points = camera.points(depth)
    across, down = _step(points, depth, 1), _step(points, depth, 0)
    normal = np.cross(down, across)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0).astype(np.float32)


def _step(points: np.ndarray, depth: np.ndarray, axis: int) -> np.ndarray:
    """(H, W, 3) the step in `points` along an axis, forward or backward, whichever changes depth less; 0 if neither."""
    points, depth = np.moveaxis(points, axis, 0), np.moveaxis(depth, axis, 0)
    jump = np.where((depth[1:] > 0) & (depth[:-1] > 0), np.abs(np.diff(depth, axis=0)), np.inf)
    edge = np.full((1, *jump.shape[1:]), np.inf)
    ahead, behind = np.concatenate([jump, edge]), np.concatenate([edge, jump])
    moved = np.diff(points, axis=0)
    still = np.zeros((1, *moved.shape[1:]))
    step = np.where((ahead <= behind)[..., None], np.concatenate([moved, still]), np.concatenate([still, moved]))
    step[~np.isfinite(np.minimum(ahead, behind))] = 0
    return np.moveaxis(step, 0, axis)


def poses(
    model: mujoco.MjModel, data: mujoco.MjData, view: View, sites: Sequence[str], bodies: Sequence[str]
) -> dict[str, np.ndarray]:
    """(4, 4) poses in the camera's OpenCV axes, m, of what the model has of these; `data` has its kinematics done."""
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
