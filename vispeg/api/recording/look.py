"""The scene, the cameras and the look of a recording with pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.formats.guard import is_file
from vispeg.recordings.cell import OPEN_CELL
from vispeg.render.cameras import model_camera
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import load_cameras
from vispeg.render.cameras.standard import SIZE, standard_cameras
from vispeg.robots.bench import shows
from vispeg.robots.scene import Scene
from vispeg.task.belief import bench_of, model_cell
from vispeg.task.world_file import load_world
from vispeg.worlds.world import World

LOOK_S = 16.0  # s, default duration of a motion for cameras
MOST = 5000  # greatest number of pictures of a recording, all cameras together


def scene_of(world: World, cameras: Sequence[Camera] = ()) -> Scene:
    """Return the scene of a model: its cell with the effects that it states, or what its robot's file contains.

    Args:
        world: the model.
        cameras: cameras on which effects of the scene may act; by default those of the scene.

    Raises:
        UserError: there is no cell, and the robot's file shows nothing but the arm.
    """
    scene = bench_of(world) if world.cell is None else model_cell(world).seen
    if world.cell is None and not shows(scene):
        expected = f"{OPEN_CELL}, a world, a model file with `cell:`, or a robot's file with more in it than the arm"
        raise UserError("pictures need something to see", key="model", expected=expected, got=world.robot)
    return replace(scene, cameras=tuple(c.name for c in cameras)) if cameras else scene


def cameras_of(names: Sequence[str], scene: Scene, size: tuple[int, int]) -> tuple[Camera, ...]:
    """Return cameras of the scene by name, or from camera files.

    Args:
        names: names of cameras of the cell or of the robot's file, and paths of camera files; a camera whose pose its
            file does not state stands where the one of its name does.
        scene: the scene.
        size: width and height, px. A cell's cameras get it and keep their horizontal field of view; cameras of the
            robot's file without a `resolution` get it and keep their vertical field of view. All others keep their own.

    Raises:
        UserError: `names` is empty, has an unknown one, or gives two cameras of the same name; or a camera's pose is
            not known.
    """
    standard = {c.name: c for c in standard_cameras(scene.tip, scene.target)} if scene.goal else {}
    own = {c.name: c for c in model_camera.cameras_of(scene.nominal, size) if c.name not in standard}
    out: list[Camera] = []
    for name in names:
        if name not in {**standard, **own} and (Path(name).suffix or is_file(name)):
            out += load_cameras(name, {**own, **standard})
        elif name in standard:
            out.append(_sized(standard[name], *size))
        elif name in own:
            out.append(own[name])
        else:
            raise UserError(
                "unknown camera",
                key="--cameras",
                got=name,
                choices=[*standard, *own],
                expected="a name or a camera file",
            )
    if not out:
        raise UserError("no camera", key="--cameras", expected="a name or a camera file", choices=[*standard, *own])
    if len({c.name for c in out}) < len(out):
        raise UserError("two cameras have the same name", key="--cameras", got=[c.name for c in out])
    return tuple(out)


def _sized(camera: Camera, width: int, height: int) -> Camera:
    """Return a standard camera with another size, px, and the same horizontal field of view."""
    scale = width / SIZE
    middle = {"cx": (width - 1) / 2, "cy": (height - 1) / 2}
    return camera.moved(width=width, height=height, fx=camera.fx * scale, fy=camera.fy * scale, **middle)


def look_of(text: str, scene: Scene) -> tuple[EffectInstance, ...]:
    """Return the effects of the family `appearance` that a world draws for an episode.

    Args:
        text: `WORLD/SEED`: the world's name or file, and the episode's seed.
        scene: the scene on which they act.

    Raises:
        UserError: no such world, or `text` does not end in `/` and a number.
    """
    name, slash, seed = text.rpartition("/")
    if not slash or not seed.isdigit():
        raise UserError("not a look", key="--look", expected="a world and a seed, such as S/3", got=text)
    drawn = load_world(name).world.sample(int(seed), scene)
    return tuple(e for e in drawn.effects if effect(e.effect).family == "appearance")


def refuse_rate(fps: float, rate_hz: float, samples: int, cameras: Sequence[Camera]) -> None:
    """Raise UserError if a motion of so many samples cannot have pictures at `fps` Hz of all these cameras."""
    if not 0 < fps <= rate_hz:
        expected = f"above 0, and at most the joints' sample rate, {rate_hz:g} Hz"
        raise UserError("not a possible frame rate", key="--fps", expected=expected, got=fps)
    if (count := fps * samples / rate_hz * len(cameras)) > MOST:
        expected = f"at most {MOST}: a lower frame rate, fewer cameras, or a shorter motion"
        raise UserError("too many pictures", key="--fps", expected=expected, got=round(count))
