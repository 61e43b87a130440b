"""The pose of a camera in the world, and its conversion to what MuJoCo's renderers take.

Camera axes are OpenCV's (x right, y down, z forward). MuJoCo's own (x right, y up, looking along -z) appear only in
`View.frustum`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.render.cameras.camera import Camera

# m. Only what lies between NEAR and FAR is drawn. The depth buffer is a reversed float, so a large ratio of FAR to NEAR
# costs no precision. The sky is drawn at 0.57 FAR or more, so a depth beyond REACH is taken for sky.
NEAR, FAR, REACH = 0.004, 100.0, 8.0
WORLD = "base"


@dataclass(frozen=True, eq=False)
class View:
    """A camera with its pose in the world frame.

    Attributes:
        camera: the camera.
        pos: (3,) optical centre, m.
        rot: (3, 3) rotation whose columns are the camera axes in the world frame.
    """

    camera: Camera
    pos: np.ndarray
    rot: np.ndarray

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4) transform from camera axes to the world frame, m."""
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = self.rot, self.pos
        return out

    @property
    def optics(self) -> Mapping[str, float]:
        """The camera's intrinsics as fields of MuJoCo's MjvGLCamera; they reproduce fx, fy, cx and cy exactly."""
        return _optics(self.camera)[0]

    def frustum(self) -> Mapping[str, Any]:
        """Return the view as the fields of MjvGLCamera: its place and its optics."""
        place = {"pos": self.pos, "forward": self.rot[:, 2], "up": -self.rot[:, 1]}
        return {**{k: v.astype(np.float32) for k, v in place.items()}, **self.optics}

    def in_sight(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """Return for each of n spheres whether any of it can lie in the view, (n,) bool.

        Args:
            centres: (n, 3) in the world frame, m.
            radii: (n,) in m; 0 marks an unbounded shape, which is always in sight.
        """
        inward = (centres - self.pos) @ (self.rot @ _optics(self.camera)[1].T)  # (n, 5), > 0 inside
        return (inward >= -radii[:, None]).all(1) | (radii == 0)


@lru_cache(maxsize=256)
def _optics(c: Camera) -> tuple[Mapping[str, float], np.ndarray]:
    """Return a camera's frustum, and the inward unit normals (5, 3) of its four sides and its front, in camera axes."""
    left, right = -(c.cx + 0.5) / c.fx * NEAR, (c.width - 0.5 - c.cx) / c.fx * NEAR
    frustum = {
        "frustum_center": (left + right) / 2,
        "frustum_width": (right - left) / 2,  # half the width, by MuJoCo's convention
        "frustum_bottom": (c.cy + 0.5 - c.height) / c.fy * NEAR,
        "frustum_top": (c.cy + 0.5) / c.fy * NEAR,
        "frustum_near": NEAR,
        "frustum_far": FAR,
        "orthographic": 0,
    }
    sides = np.array(
        [
            (c.fx, 0, c.cx + 0.5),
            (-c.fx, 0, c.width - 0.5 - c.cx),
            (0, c.fy, c.cy + 0.5),
            (0, -c.fy, c.height - 0.5 - c.cy),
            (0, 0, 1),
        ]
    )
    return frustum, sides / np.linalg.norm(sides, axis=1)[:, None]


@lru_cache(maxsize=256)
def _place(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Return a camera's position (3,), m, and axes (3, 3) in its parent's frame, read only."""
    pos, rot = np.array(camera.pos), camera.rotation
    pos.flags.writeable = rot.flags.writeable = False
    return pos, rot


def parent_of(model: mujoco.MjModel, name: str) -> tuple[str, int]:
    """Return the kind (`world`, `site` or `body`) and the id of a camera's parent.

    Raises:
        UserError: the model has no site or body of that name; the message lists the sites.
    """
    if name == WORLD:
        return "world", 0
    for kind, object_type in (("site", mujoco.mjtObj.mjOBJ_SITE), ("body", mujoco.mjtObj.mjOBJ_BODY)):
        if (index := mujoco.mj_name2id(model, object_type, name)) >= 0:
            return kind, index
    names = (WORLD, *(model.site(i).name for i in range(model.nsite)))
    raise UserError("a camera without a parent", key="parent", expected="a site or body", got=name, choices=names)


def view_of(camera: Camera, parent: tuple[str, int], data: mujoco.MjData) -> View:
    """Return the camera with its world pose for the parent's pose in `data`, whose kinematics must be computed."""
    (kind, i), (at, axes) = parent, _place(camera)
    if kind == "world":
        return View(camera, at, axes)
    pos, rot = (data.site_xpos[i], data.site_xmat[i]) if kind == "site" else (data.xpos[i], data.xmat[i])
    rot = rot.reshape(3, 3)
    return View(camera, pos + rot @ at, rot @ axes)


def velocity_of(
    view: View,
    parent: tuple[str, int],
    model: mujoco.MjModel,
    data: mujoco.MjData,
    qvel: np.ndarray | None,
    relative_to: int,
) -> np.ndarray:
    """Return the velocity (6,) of a camera relative to a body, in the camera's axes, m/s and rad/s.

    The kinematics and the positions relative to the centre of mass in `data` must be computed.

    Args:
        view, parent: the camera in the world, and what it is fixed to.
        model, data: of the cell.
        qvel: (nv,) joint velocities; None is at rest.
        relative_to: id of the body; 0 is the world.
    """
    kind, i = parent
    carrier = 0 if kind == "world" else int(model.site_bodyid[i]) if kind == "site" else i
    if qvel is None or model.body_weldid[carrier] == model.body_weldid[relative_to]:
        return np.zeros(6)
    own, other = np.zeros((2, 2, 3, model.nv))
    mujoco.mj_jac(model, data, own[0], own[1], view.pos, carrier)
    mujoco.mj_jac(model, data, other[0], other[1], view.pos, relative_to)
    return ((own - other) @ qvel @ view.rot).reshape(-1)


def planar(buffer: np.ndarray) -> np.ndarray:
    """Convert a reversed depth buffer (1 at NEAR, 0 at FAR) to planar depth, float32 in m, 0 beyond REACH."""
    depth = np.float32(NEAR * FAR) / (np.float32(NEAR) + buffer * np.float32(FAR - NEAR))
    depth[depth > REACH] = 0
    return depth
