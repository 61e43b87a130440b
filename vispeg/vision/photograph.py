"""Take pictures of a moving arm as a camera does: delayed, row by row, while the shutter is open, through its sensor.

What a picture shows depends on the motion itself, so delay, rolling shutter and the blur of a moving camera are not
made from one still picture: the cell is drawn at the moments that the camera saw.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.render.backends.backend import BackendName
from vispeg.render.block_matching import NAME, settings
from vispeg.render.calibration.board import Board
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.robots.scene import Scene
from vispeg.vision.board_picture import put_down, showing
from vispeg.vision.eye import recorded_of
from vispeg.vision.predict import Predictor, delivered
from vispeg.vision.shutter import DRAWN, Path, Shutter, exposed
from vispeg.worlds.places import acts_on
from vispeg.worlds.split import optical
from vispeg.worlds.world import World

FINER = 3  # rays per pixel in each direction
DEPTH_UNIT = 1e-4  # m, step of recorded depth


def photograph(
    scene: Scene,
    cameras: Sequence[Camera],
    world: World,
    path: Path,
    times: np.ndarray,
    seed: int,
    *,
    backend: BackendName = "auto",
    shadows: bool = False,
    finer: int = FINER,
    board: Board | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Frames:
    """Take pictures of a cell along a motion, with all cameras at all times.

    Args:
        scene: the cell, with the effects that it states.
        cameras: nominal cameras; the frames state these, and `world` has the true deviations from them.
        world: effects on looks, cameras and sensors, and on the poses of fixture and held part.
        path: function from times (n,) s to true joint angles (n, nj) rad.
        times: (n,) s, time stamps of the pictures.
        seed: of the sensors' noise and of the board's pose.
        backend, shadows: of the renderer.
        finer: rays per pixel in each direction, an odd number.
        board: lies on the table beside the fixture (`put_down`); None for no board.
        progress: called with the share of pictures taken, 0 to 1.

    Raises:
        UserError: the world has depth by block matching, which works only in the task's own pictures.
    """
    frames: list[RecordedFrame] = []
    beside = () if board is None else (showing(board, put_down(board, scene, seed)),)
    with Predictor(scene, cameras, backend, shadows, finer, *beside) as predictor:
        predictor.see(world)
        world, offsets = predictor.world, predictor.geometry.offsets
        for camera in cameras:
            if settings(world, camera.name) is not None:
                what = "depth by block matching is not made along a motion"
                raise UserError(what, key=camera.name, expected="a world without the effect", got=NAME)

        def measured(time: np.ndarray) -> np.ndarray:
            return path(time) + offsets

        for k, camera in enumerate(cameras):
            shutter, sensor = Shutter.of(world, camera.name), _sensor(world, camera)
            recorded = recorded_of(camera, DEPTH_UNIT)
            for i, time in enumerate(times):
                rendering = exposed(predictor, camera.name, shutter, measured, float(time))
                rng = stream(seed, "frames", camera.name, i)
                rgb, depth = delivered(sensor, rendering, rng, time=float(time))
                frames.append(RecordedFrame(float(time), recorded, rgb, depth))
                progress((k * len(times) + i + 1) / (len(cameras) * len(times)))
    frames.sort(key=lambda frame: frame.time)
    return Frames({frame.camera.name: frame.camera for frame in frames}, tuple(frames))


def _sensor(world: World, camera: Camera) -> Pipeline:
    """Return the sensor effects of a camera, which are applied after rendering and may have state."""
    sensor = optical(world, [camera.name]).only(lambda e: effect(e.effect).family == "camera" and e.effect not in DRAWN)
    return Pipeline([replace(sensor, effects=tuple(_still(e, camera.name) for e in sensor.effects))], camera.name)


def _still(placed: EffectInstance, camera: str) -> EffectInstance:
    """Return an effect; motion blur without its exposure, since `exposed` has already blurred the picture by motion."""
    if placed.effect != "motion_blur" or not acts_on(placed.where, [camera]):
        return placed
    numbers = {name: value.value for name, value in placed.params.items()}
    return EffectInstance.of(placed.effect, placed.where, **{**numbers, "exposure": 0.0})
