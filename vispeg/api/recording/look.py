"""Recordings with pictures, of a simulated arm that looks at its cell."""

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

DURATION = 16.0  # s
LATEST = 0.5  # s at either end without pictures: what a late camera shows lies within the motion
MOST = 5000  # frames


def scene_of(world: World, cameras: Sequence[Camera] = ()) -> Scene:
    """Return the scene of a model with these cameras for effects to act on: its cell, or the bench in its robot's file.

    Raises:
        UserError: an arm alone, which shows nothing.
    """
    scene = bench_of(world) if world.cell is None else model_cell(world).scene
    if world.cell is None and not shows(scene):
        expected = f"{OPEN_CELL}, a world, a model file with `cell:`, or a robot's file with more in it than the arm"
        raise UserError("pictures need something to see", key="model", expected=expected, got=world.robot)
    return replace(scene, cameras=tuple(c.name for c in cameras)) if cameras else scene


def cameras_of(names: Sequence[str], scene: Scene, size: tuple[int, int]) -> tuple[Camera, ...]:
    """Cameras by the names of the scene's own, at this width and height in px, or from camera files.

    A cell's cameras keep their horizontal field of view, those of the robot's file without a `resolution` their
    vertical one; all others are as their file says.

    Raises:
        UserError: no such camera, or two of one name.
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
    """Return the appearance of `WORLD/SEED`: what a world draws for the episode of that seed.

    Raises:
        UserError: no such world, or no seed.
    """
    name, slash, seed = text.rpartition("/")
    if not slash or not seed.isdigit():
        raise UserError("no look", key="--look", expected="a world and a seed, such as S/3", got=text)
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
    """Let an arm in its cell, or on its bench, look about; its joints are recorded, and what its cameras see.

    Args:
        world: of a cell, or of a robot whose own file shows what stands about. Effects of the arm act on the motion,
            those of cameras, looks, fixture and grip on the pictures; the recording states none of them.
        motion: one of `vispeg.identify.motions.look_motion.LOOKS`, or what is commanded, at `rate_hz`.
        cameras: as their user believes them; `wrist_wide` of the cell at 320 x 240 px if none is given.
        fps: pictures a second of each camera.
        duration: s, of a motion by name.
        rate_hz: samples a second.
        noise: 1-sigma of the joint sensors.
        seed: of the noise and of what the cameras' sensors draw.
        backend, shadows: of the renderer.
        name: what the recording is called.
        progress: called with the share of the pictures that is taken.

    Raises:
        UserError: nothing to see, no such motion, or one that the arm cannot make; too many pictures.
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
    """Raise UserError for pictures that nobody can take, or too many of them."""
    if not 0 < fps <= rate_hz or fps * duration * len(cameras) > MOST:
        expected = f"above 0, and at most {MOST} pictures in all"
        raise UserError("no such rate of pictures", key="--fps", expected=expected, got=fps)


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
    """Pictures of a recorded motion, `fps` a second of each camera.

    Args:
        world, scene, cameras: what is photographed, with the board that the world's cell states.
        rec: its samples.
        truth: (n, nj) rad, where the joints were at its samples.
        fps: pictures a second.
        rng: of the stamps: a camera's clock is not the controller's, they lie anywhere between two samples.
        seed, backend, shadows, progress: as for `record_look`.
    """
    times = np.arange(LATEST, rec.time[-1] - LATEST, 1 / fps)
    times = times + rng.uniform(0, 0.5 / rec.rate_hz, len(times))
    curve = CubicSpline(rec.time, truth)
    drawn = {"backend": backend, "shadows": shadows, "board": board_of(world.cell), "progress": progress}
    return photograph(scene, cameras, world, curve, times, seed, **drawn)


__all__ = ["LOOKS", "cameras_of", "look_of", "record_look", "refuse_rate", "scene_of", "taken"]
