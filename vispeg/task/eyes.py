"""A task's cameras and the observation spaces of their images."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym

from vispeg.core.errors import UserError
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import load_camera
from vispeg.render.cameras.rig import CameraRig
from vispeg.render.cameras.standard import standard_cameras
from vispeg.render.image_kinds import MODES, key_of
from vispeg.robots.scene import Scene
from vispeg.task.config import TaskConfig
from vispeg.task.world_file import WorldFile
from vispeg.worlds.randomized import RandomizedWorld

if TYPE_CHECKING:
    from vispeg.render.backends.backend import BackendName

FILM = (320, 240)  # px, width and height of the pictures that `render` returns


def image_spaces(obs_mode: str, cameras: Sequence[Camera]) -> dict[str, gym.Space]:
    """Return the observation spaces of a mode's images by key (KIND_CAMERA), see vispeg.render.image_kinds.

    Keys are in the order of cameras, and for each camera in that of the kinds' names (depth before rgb).
    """
    out: dict[str, gym.Space] = {}
    for c in cameras:
        for kind in sorted(MODES[obs_mode], key=lambda k: k.name):
            out[key_of(kind, c.name)] = gym.spaces.Box(0, kind.high, kind.shape(c.height, c.width), kind.dtype)
    return out


def task_cameras(scene: Scene, task: TaskConfig, stated: Mapping[str, Any]) -> tuple[Camera, ...]:
    """Return the cameras of a task.

    Args:
        scene: the cell.
        task: settings with the cameras' names and the image size.
        stated: `cameras` of a world file: for each name a camera file (if it states no pose, the camera has that of
            the standard camera of this name), or a mapping of what differs from the standard camera of this name (of
            the standard camera `external` for any other name).

    Raises:
        UserError: no camera of that name, or a file as `load_camera` refuses it.
    """
    by_name = {c.name: c for c in standard_cameras(scene.tip, scene.target)}
    usual = dict(by_name)
    for name, change in stated.items():
        if isinstance(change, str):
            by_name[name] = load_camera(change, usual, name)
        else:
            by_name[name] = usual.get(name, usual["external"]).moved(name=name, **change)
    for name in task.cameras:
        if name not in by_name:
            raise UserError("unknown camera", key="cameras", got=name, choices=by_name)
    size = task.image_size
    return tuple(resized(by_name[n], size) if size else by_name[n] for n in task.cameras)


def resized(camera: Camera, size: int) -> Camera:
    """Return a copy of the camera with `size` px along its shorter side and the same field of view."""
    s = size / min(camera.width, camera.height)
    return camera.moved(
        width=round(camera.width * s),
        height=round(camera.height * s),
        fx=camera.fx * s,
        fy=camera.fy * s,
        cx=(camera.cx + 0.5) * s - 0.5,
        cy=(camera.cy + 0.5) * s - 0.5,
    )


def rig_of(
    scene: Scene,
    task: TaskConfig,
    world: RandomizedWorld,
    obs_mode: str,
    rows: int,
    file: WorldFile | None = None,
    backend: str = "auto",
    look_seed: Callable[[int], int] | None = None,
) -> CameraRig:
    """Return the camera rig for `rows` cells of a task; it has no cameras if observations hold no images.

    Args:
        scene: the cell.
        task: settings that name the cameras.
        world: the world whose looks and camera errors are drawn.
        obs_mode: observation mode, which decides the kinds of images.
        rows: number of cells.
        file: the world's file, for its cameras and renderer; or None.
        backend: of the renderer, if the file names none.
        look_seed: see CameraRig.
    """
    wanted = MODES[obs_mode]
    renderer = file.renderer if file is not None else {}
    cameras = task_cameras(scene, task, file.cameras if file is not None else {}) if wanted else ()
    width, height = FILM
    *_, external = standard_cameras(scene.tip, scene.target)
    outside = resized(external, height)
    return CameraRig(
        scene,
        cameras,
        world,
        rows,
        kinds=wanted,
        period=task.policy_period,
        outside=outside.moved(name="film", width=width, cx=(width - 1) / 2),
        backend=cast("BackendName", renderer.get("backend", backend)),  # a renderer refuses other words
        shadows=bool(renderer.get("shadows", False)),
        look_seed=look_seed,
    )
