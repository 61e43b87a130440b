"""Make recordings with pictures, of a simulated arm that moves its cameras around."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

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

DURATION = 16.0  # s, default duration
LATEST = 0.5  # s at either end without pictures, so that delayed pictures still show a moment of the motion
MOST = 5000  # most pictures in all


def scene_of(world: World, cameras: Sequence[Camera] = ()) -> Scene:
    """Return the scene of a model, with these cameras as places of effects: its cell, or the bench in its robot's file.

    Raises:
        UserError: the model is only an arm, so there is nothing to see.
    """
    scene = bench_of(world) if world.cell is None else model_cell(world).scene
    if world.cell is None and not shows(scene):
        expected = f"{OPEN_CELL}, a world, a model file with `cell:`, or a robot's file with more in it than the arm"
        raise UserError("pictures need something to see", key="model", expected=expected, got=world.robot)
    return replace(scene, cameras=tuple(c.name for c in cameras)) if cameras else scene


def cameras_of(names: Sequence[str], scene: Scene, size: tuple[int, int]) -> tuple[Camera, ...]:
    """Return cameras of the scene by name, with this width and height, px, or cameras from files.

    A cell's cameras keep their horizontal field of view. Cameras of the robot's file without a `resolution` keep their
    vertical one. Others keep the size in their file.

    Raises:
        UserError: no such camera, no camera, or two cameras of one name.
    """
    standard = {c.name: c for c in standard_cameras(scene.tip, scene.target)} if scene.goal else {}
    own = {c.name: c for c in model_camera.cameras_of(scene.nominal, size) if c.name not in standard}
    out: list[Camera] = []
    for name in names:
        if name not in {**standard, **own} and (Path(name).suffix or is_file(name)):
            out += load_cameras(name)
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
    if len({c.name for c in out}) < len(out) or not out:
        raise UserError("cameras of different names", key="--cameras", got=[c.name for c in out])
    return tuple(out)


def _sized(camera: Camera, width: int, height: int) -> Camera:
    scale = width / SIZE
    middle = {"cx": (width - 1) / 2, "cy": (height - 1) / 2}
    return camera.moved(width=width, height=height, fx=camera.fx * scale, fy=camera.fy * scale, **middle)


def look_of(text: str, scene: Scene) -> tuple[EffectInstance, ...]:
    """Return the appearance effects of `WORLD/SEED`, which the world draws for the episode of that seed.

    Raises:
        UserError: no such world, or not a seed.
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
    seed: int = 0,
    backend: BackendName = "auto",
    shadows: bool = False,
    name: str = "look",
    progress: Callable[[float], None] = lambda share: None,
) -> Recording:
    """Record the joints of an arm in its cell or on its bench, and pictures of its cameras.

    Args:
        world: a world with a cell, or with a robot whose file shows more than the arm. Effects of the arm act on the
            motion, those of cameras, appearance, fixture and grip on the pictures; the recording states none of them.
        motion: a name in `vispeg.identify.motions.look_motion.LOOKS`, or a commanded motion at `rate_hz`.
        cameras: the nominal cameras; by default `wrist_wide` of the cell with 320 x 240 px.
        fps: frame rate of each camera, Hz.
        duration: duration of a motion given by name, s.
        rate_hz: sample rate of the joints, Hz.
        noise: standard deviations of the joint sensors' noise.
        seed: seed of the noise and of the camera sensors.
        backend, shadows: the renderer, and whether it draws shadows.
        name: name of the recording.
        progress: called with the share of pictures taken.

    Raises:
        UserError: nothing to see, no such motion, a motion that the arm cannot make, or too many pictures.
    """
    cameras = cameras or cameras_of(["wrist_wide"], scene_of(world), (320, 240))
    scene = scene_of(world, cameras)
    duration = (duration or DURATION) if isinstance(motion, str) else float(motion.time[-1])
    refuse_rate(fps, rate_hz, duration, cameras)
    path = look_motion(motion, scene, rate_hz, duration) if isinstance(motion, str) else motion
    arm = replace(of_arm(world), cell=None)
    truth: list[np.ndarray] = []
    control = controller(scene.nominal, "position", rate_hz, centre_of(scene.nominal))
    rng = stream(seed, "record", "noise")
    rec = record(arm, path, control, noise, rng, torque_sensor="joint", name=name, watch=truth.append)
    options = {"seed": seed, "backend": backend, "shadows": shadows, "progress": progress}
    frames = taken(world, scene, cameras, rec, truth[0], fps, rng, **options)
    cell = CellBelief(DEFAULT) if world.cell is not None and world.cell.open else world.cell
    return replace(rec, frames=frames, cell=cell, motion=path.name)


def refuse_rate(fps: float, rate_hz: float, duration: float, cameras: Sequence[Camera]) -> None:
    """Raise UserError for an impossible frame rate, or too many pictures."""
    if not 0 < fps <= rate_hz or fps * duration * len(cameras) > MOST:
        expected = f"above 0, and at most {MOST} pictures in all"
        raise UserError("not a possible frame rate", key="--fps", expected=expected, got=fps)


def taken(
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
        world, scene, cameras: the scene to photograph, with the board that the world's cell states, and the cameras.
        rec: the recorded motion.
        truth: (n, nj) true joint angles at its samples, rad.
        fps: frame rate of each camera, Hz.
        rng: random stream of the time stamps, which do not coincide with samples, as a camera has its own clock.
        seed, backend, shadows, progress: as for `record_look`.
    """
    times = np.arange(LATEST, rec.time[-1] - LATEST, 1 / fps)
    times = times + rng.uniform(0, 0.5 / rec.rate_hz, len(times))
    curve = CubicSpline(rec.time, truth)
    drawn = {"backend": backend, "shadows": shadows, "board": board_of(world.cell), "progress": progress}
    return photograph(scene, cameras, world, curve, times, seed, **drawn)


__all__ = ["LOOKS", "cameras_of", "look_of", "record_look", "refuse_rate", "scene_of", "taken"]
