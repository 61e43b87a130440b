"""Record the joints of a simulated arm that moves in front of or with cameras, and the cameras' pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.formats.guard import is_file
from vispeg.identify.excitation import Motion
from vispeg.identify.motions.look_motion import LOOKS, look_motion
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.cell import OPEN_CELL, CellBelief
from vispeg.recordings.frames.frames import Frames
from vispeg.recordings.noise import NOISE
from vispeg.recordings.recording import Recording
from vispeg.render.backends.backend import BackendName
from vispeg.render.cameras import model_camera
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import load_cameras
from vispeg.render.cameras.standard import SIZE, standard_cameras
from vispeg.robots.bench import shows
from vispeg.robots.scene import Scene
from vispeg.task.belief import DEFAULT, bench_of, model_cell
from vispeg.task.world_file import load_world
from vispeg.vision.board import board_of
from vispeg.vision.photograph import photograph
from vispeg.worlds.split import of_arm
from vispeg.worlds.world import World

DURATION = 16.0  # s, default duration of a motion
MARGIN = 0.5  # s without pictures at either end of a motion, so that what delayed pictures show is within the motion
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


def record_look(
    world: World,
    motion: str | Motion = "look",
    cameras: Sequence[Camera] = (),
    *,
    fps: float = 3.0,
    duration: float | None = None,
    rate_hz: float = 500.0,
    noise: Mapping[str, float] = NOISE,
    torque_sensor: Literal["joint", "motor", "none"] = "joint",
    seed: int = 0,
    backend: BackendName = "auto",
    shadows: bool = False,
    name: str = "look",
    progress: Callable[[float], None] = lambda share: None,
) -> Recording:
    """Record the joints of a simulated arm during a motion, and pictures of its scene.

    Args:
        world: a world with a cell, or with a robot whose file shows more than the arm. Effects of the arm act on the
            motion, those of cameras, appearance, fixture and grip on the pictures. So do those that its cell states, as
            far as the arm alone has their places; the recording mentions only these.
        motion: a name in `vispeg.identify.motions.look_motion.LOOKS`, or a commanded motion at `rate_hz`.
        cameras: the nominal cameras; by default `wrist_wide` of the cell with 320 x 240 px.
        fps: frame rate of each camera, Hz.
        duration: duration of a motion given by name, s; by default 16 s. A commanded motion has its own.
        rate_hz: sample rate of the joints, Hz.
        noise: signal of the joints -> standard deviation of its noise, as in recording.yaml.
        torque_sensor: what `tau` measures: torque behind the gear, motor torque, or nothing.
        seed: seed of the noise and of the camera sensors.
        backend, shadows: the renderer, and whether it draws shadows.
        name: name of the recording.
        progress: called with the share of pictures taken so far, 0 to 1.

    Raises:
        UserError: the scene has nothing but the arm, no such motion, a motion that the arm cannot make, an impossible
            frame rate, or more than 5000 pictures.
    """
    cameras = cameras or cameras_of(["wrist_wide"], scene_of(world), (320, 240))
    scene = scene_of(world, cameras)
    duration = DURATION if duration is None else duration
    duration = duration if isinstance(motion, str) else float(motion.time[-1])
    refuse_rate(fps, rate_hz, duration, cameras)
    path = look_motion(motion, scene, rate_hz, duration) if isinstance(motion, str) else motion
    stated = [e for e in scene.stated if effect(e.effect).targets(scene.nominal)]
    arm = replace(of_arm(world.over(stated)), cell=None)
    truth: list[np.ndarray] = []
    control = controller(scene.nominal, "position", rate_hz, centre_of(scene.nominal))
    rng = stream(seed, "record", "noise")
    rec = record(arm, path, control, noise, rng, torque_sensor=torque_sensor, name=name, watch=truth.append)
    options = {"seed": seed, "backend": backend, "shadows": shadows, "progress": progress}
    frames = pictures_of(world, scene, cameras, rec, truth[0], fps, rng, **options)
    cell = CellBelief(DEFAULT) if world.cell is not None and world.cell.open else world.cell
    return replace(rec, frames=frames, cell=cell, motion=path.name)


def refuse_rate(fps: float, rate_hz: float, duration: float, cameras: Sequence[Camera]) -> None:
    """Raise UserError if `fps` is not in (0, `rate_hz`], or these cameras take over MOST pictures in `duration` s."""
    if not 0 < fps <= rate_hz:
        expected = f"above 0, and at most the joints' sample rate, {rate_hz:g} Hz"
        raise UserError("not a possible frame rate", key="--fps", expected=expected, got=fps)
    if (count := fps * duration * len(cameras)) > MOST:
        expected = f"at most {MOST}: a lower frame rate, fewer cameras, or a shorter motion"
        raise UserError("too many pictures", key="--fps", expected=expected, got=round(count))


def pictures_of(
    world: World,
    scene: Scene,
    cameras: Sequence[Camera],
    rec: Recording,
    truth: np.ndarray,
    fps: float,
    rng: np.random.Generator,
    *,
    seed: int,
    backend: BackendName = "auto",
    shadows: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> Frames:
    """Render pictures of a recorded motion.

    Args:
        world: its effects act on scene, cameras and sensors; a board that its cell states is in view.
        scene: the scene to photograph, with the effects that it states.
        cameras: the nominal cameras.
        rec: the recorded motion.
        truth: (n, nj) true joint angles at its samples, rad.
        fps: frame rate of each camera, Hz.
        rng: random stream of the time stamps: as a camera has its own clock, they differ from those of the samples.
        seed, backend, shadows, progress: as for `record_look`.
    """
    times = np.arange(MARGIN, rec.time[-1] - MARGIN, 1 / fps)
    times = times + rng.uniform(0, 0.5 / rec.rate_hz, len(times))
    curve = CubicSpline(rec.time, truth)
    drawn = {"backend": backend, "shadows": shadows, "board": board_of(world.cell), "progress": progress}
    return photograph(scene, cameras, world, curve, times, seed, **drawn)


__all__ = ["LOOKS", "cameras_of", "look_of", "record_look", "refuse_rate", "scene_of", "pictures_of"]
