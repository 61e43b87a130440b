"""Cameras as rows of a MuJoCo model, so that effects can write them like any other field of it.

MuJoCo's camera looks along -z with y up. MuJoCo states the principal point as an offset from the middle of the sensor,
in m. In px, c = size / 2 - offset / pixel size, counted from the outer corner of the first pixel; our `cx` and `cy`
count from its centre and are 0.5 smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.rotation import quaternion
from vispeg.render.cameras.camera import Camera, rotation
from vispeg.render.cameras.view import WORLD, parent_of
from vispeg.robots.model import RobotModel

FLIP = np.diag([1.0, -1.0, -1.0])  # converts OpenCV's camera axes to MuJoCo's, and back
PIXEL = 1e-5  # m, size of a pixel on the sensor; an arbitrary value, which does not change the picture


def cameras_of(robot: RobotModel, size: tuple[int, int] = (0, 0)) -> tuple[Camera, ...]:
    """Return the cameras that are defined in a robot's own file.

    A camera's parent is `flange` or `base` where the camera is rigidly connected to it, else its body or another frame
    that moves with it. Cameras without a name, those that track a target (a mode other than `fixed`), orthographic
    ones, those without such a frame, and those that `Camera` refuses are left out.

    Args:
        robot: the robot model.
        size: (width, height) px for cameras whose file states no `resolution`; by default these are left out.
    """
    model = robot.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    out = []
    for i in range(model.ncam):
        body = int(model.cam_bodyid[i])
        width, height = (int(n) for n in model.cam_resolution[i])
        if min(width, height) <= 1:  # MuJoCo's default: the file states no resolution
            width, height = size
        fixed = int(model.cam_mode[i]) == mujoco.mjtCamLight.mjCAMLIGHT_FIXED.value
        pinhole = int(model.cam_projection[i]) == mujoco.mjtProjection.mjPROJ_PERSPECTIVE.value
        if not (width and height and fixed and pinhole and model.camera(i).name):
            continue
        parent = _parent_name(model, body)
        if parent is None:
            continue
        mount, pos, rot = _mount(model, parent)
        turn = data.xmat[mount].reshape(3, 3)
        pos, rot = data.xpos[mount] + turn @ pos, turn @ rot
        axes = data.cam_xmat[i].reshape(3, 3) @ FLIP
        focal = np.full(2, height / 2 / np.tan(np.radians(model.cam_fovy[i]) / 2))
        centre = np.array([width - 1, height - 1]) / 2
        if model.cam_sensorsize[i].min() > 0:
            scale = np.array([width, height]) / model.cam_sensorsize[i]
            focal, centre = model.cam_intrinsic[i][:2] * scale, centre - model.cam_intrinsic[i][2:] * scale
        name, at = model.camera(i).name, rot.T @ (data.cam_xpos[i] - pos)
        quat = tuple(quaternion(rot.T @ axes).tolist())
        (fx, fy), (cx, cy) = map(float, focal), map(float, centre)
        with suppress(UserError):  # a lens that no picture is made of must not take the other cameras along
            out.append(Camera(name, width, height, fx, fy, cx, cy, parent=parent, pos=tuple(at.tolist()), quat=quat))
    return tuple(out)


def _parent_name(model: mujoco.MjModel, body: int) -> str | None:
    """Return the first name that `parent_of` takes for a frame rigidly connected to a body; None if there is none.

    The body's own name may be that of a site elsewhere, or `base`.
    """
    bodies = [model.body(i).name for i in range(model.nbody)]
    names = ["flange", WORLD, bodies[body], *bodies[1:], *(model.site(i).name for i in range(model.nsite))]
    rigid = (n for n in names if n and model.body_weldid[_mount(model, n)[0]] == model.body_weldid[body])
    return next(rigid, None)


def add(spec: mujoco.MjSpec, cameras: tuple[Camera, ...]) -> None:
    """Add a camera to a spec for each of `cameras` whose name is new; `write` sets its values in the compiled model."""
    names = {camera.name for camera in spec.cameras}
    for camera in cameras:
        if camera.name not in names:
            names.add(camera.name)
            size = [PIXEL * camera.width, PIXEL * camera.height]
            _parent_body(spec, camera.parent).add_camera(
                # `write` sets the focal length
                name=camera.name,
                sensor_size=size,
                focal_pixel=[1, 1],
                resolution=[camera.width, camera.height],
            )


def add_complete(spec: mujoco.MjSpec, cameras: Sequence[Camera]) -> None:
    """Add these cameras to a spec in MuJoCo's own conventions, for a file that plain MuJoCo reads.

    Lens distortion is lost, since MuJoCo has none.
    """
    model = spec.copy().compile()  # poses of the parents, however the file states them
    for camera in cameras:
        _, pos, rot = _mount(model, camera.parent)
        size = np.array([camera.width, camera.height])
        _parent_body(spec, camera.parent).add_camera(
            name=camera.name,
            pos=pos + rot @ camera.pos,
            quat=quaternion(rot @ camera.rotation @ FLIP),
            sensor_size=PIXEL * size,
            focal_pixel=[camera.fx, camera.fy],
            principal_pixel=size / 2 - 0.5 - (camera.cx, camera.cy),
            resolution=size,
        )


def _parent_body(spec: mujoco.MjSpec, parent: str) -> mujoco.MjsBody:
    """Return the body of a camera's parent; the world's body for WORLD, and for a parent that the spec lacks."""
    if parent == WORLD:
        return spec.worldbody
    site = spec.site(parent)
    body = site.parent if site is not None else spec.body(parent)
    return body or spec.worldbody


def row_of(model: mujoco.MjModel, camera: Camera) -> int | None:
    """Return the row of a camera; None if the model has no camera of that name on the parent's body.

    Raises:
        UserError: the model has no such parent.
    """
    row = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera.name)
    body, _, _ = _mount(model, camera.parent)
    return row if row >= 0 and model.cam_bodyid[row] == body else None


def write(model: mujoco.MjModel, row: int, camera: Camera) -> None:
    """Write a camera's intrinsics, size and pose to its row of the model."""
    _, pos, rot = _mount(model, camera.parent)
    size = np.array([camera.width, camera.height])
    principal = size / 2 - 0.5 - (camera.cx, camera.cy)
    model.cam_mode[row] = mujoco.mjtCamLight.mjCAMLIGHT_FIXED.value
    model.cam_resolution[row], model.cam_sensorsize[row] = size, PIXEL * size
    model.cam_intrinsic[row] = PIXEL * np.array([camera.fx, camera.fy, *principal])
    model.cam_fovy[row] = np.degrees(2 * np.arctan(camera.height / 2 / camera.fy))
    model.cam_pos[row] = pos + rot @ camera.pos
    model.cam_quat[row] = quaternion(rot @ camera.rotation @ FLIP)


def read(model: mujoco.MjModel, row: int, camera: Camera) -> Camera:
    """Return `camera` with the intrinsics and the pose that a row of the model has."""
    _, pos, rot = _mount(model, camera.parent)
    size = np.array([camera.width, camera.height])
    focal, principal = np.split(
        model.cam_intrinsic[row].astype(float) / np.tile(model.cam_sensorsize[row] / size, 2), 2
    )
    centre = size / 2 - 0.5 - principal
    quat = model.cam_quat[row] / np.linalg.norm(model.cam_quat[row])
    return camera.moved(
        fx=focal[0],
        fy=focal[1],
        cx=centre[0],
        cy=centre[1],
        pos=rot.T @ (model.cam_pos[row] - pos),
        quat=tuple(quaternion(rot.T @ rotation(quat) @ FLIP).tolist()),
    )


def _mount(model: mujoco.MjModel, parent: str) -> tuple[int, np.ndarray, np.ndarray]:
    """Return the id of a parent's body, and the parent's position (3,), m, and axes (3, 3) in that body's frame."""
    kind, i = parent_of(model, parent)
    if kind == "site":
        return int(model.site_bodyid[i]), model.site_pos[i], rotation(model.site_quat[i])
    return i, np.zeros(3), np.eye(3)
