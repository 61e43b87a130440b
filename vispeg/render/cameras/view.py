"""Where a camera stands in the world, and the same thing in the axes that MuJoCo's renderers use.

OpenCV's camera axes (x right, y down, z forward) hold everywhere else; MuJoCo's (x right, y up, looking along -z) only
where a frustum is handed over.
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

# m. Nothing nearer or further is drawn; depth is a reversed float, so the ratio costs no precision. The sky is drawn at
# 0.57 FAR or more, so a reading beyond REACH is one of the sky.
NEAR, FAR, REACH = 0.004, 100.0, 8.0
WORLD = "base"


@dataclass(frozen=True, eq=False)
class View:
    """A camera at a place in the world frame.

    Attributes:
        camera: what it is.
        pos: (3,) optical centre, m.
        rot: (3, 3) camera axes in the world, one a column.
    """

    camera: Camera
    pos: np.ndarray
    rot: np.ndarray

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4) camera axes to world, m."""
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = self.rot, self.pos
        return out

    def frustum(self) -> Mapping[str, Any]:
        """MuJoCo's description of the view: fields of an MjvGLCamera, which realise fx, fy, cx, cy as they are."""
        place = {"pos": self.pos, "forward": self.rot[:, 2], "up": -self.rot[:, 1]}
        return {**{k: v.astype(np.float32) for k, v in place.items()}, **_optics(self.camera)[0]}

    def in_sight(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """(n,) whether spheres (n, 3) with radii (n,) in m, world frame, may show; a radius of 0 means unbounded."""
        inward = (centres - self.pos) @ (self.rot @ _optics(self.camera)[1].T)  # (n, 5), > 0 inside
        return (inward >= -radii[:, None]).all(1) | (radii == 0)


@lru_cache(maxsize=256)
def _optics(c: Camera) -> tuple[Mapping[str, float], np.ndarray]:
    """Return a camera's frustum, and the inward normals (5, 3) of its sides and front in camera axes."""
    left, right = -(c.cx + 0.5) / c.fx * NEAR, (c.width - 0.5 - c.cx) / c.fx * NEAR
    frustum = {
        "frustum_center": (left + right) / 2,
        "frustum_width": (right - left) / 2,  # half of it: MuJoCo's convention
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
    """Give a camera's place (3,) and axes (3, 3) in its parent; read only."""
    pos, rot = np.array(camera.pos), camera.rotation
    pos.flags.writeable = rot.flags.writeable = False
    return pos, rot


def parent_of(model: mujoco.MjModel, name: str) -> tuple[str, int]:
    """(`world` | `site` | `body`, id) of what carries a camera. Raises UserError that lists the sites."""
    if name == WORLD:
        return "world", 0
    for kind, of in (("site", mujoco.mjtObj.mjOBJ_SITE), ("body", mujoco.mjtObj.mjOBJ_BODY)):
        if (index := mujoco.mj_name2id(model, of, name)) >= 0:
            return kind, index
    names = (WORLD, *(model.site(i).name for i in range(model.nsite)))
    raise UserError("a camera without a parent", key="parent", expected="a site or body", got=name, choices=names)


def view_of(camera: Camera, parent: tuple[str, int], data: mujoco.MjData) -> View:
    """Give the camera where its parent stands in `data` (kinematics done)."""
    (kind, i), (at, axes) = parent, _place(camera)
    if kind == "world":
        return View(camera, at, axes)
    pos, rot = (data.site_xpos[i], data.site_xmat[i]) if kind == "site" else (data.xpos[i], data.xmat[i])
    rot = rot.reshape(3, 3)
    return View(camera, pos + rot @ at, rot @ axes)


def planar(buffer: np.ndarray) -> np.ndarray:
    """Depth in m along the optical axis, float32, 0 beyond REACH, from a reversed buffer: 1 at NEAR, 0 at FAR."""
    depth = np.float32(NEAR * FAR) / (np.float32(NEAR) + buffer * np.float32(FAR - NEAR))
    depth[depth > REACH] = 0
    return depth
