"""Takes pictures of a moving arm as a camera would: late, row by row, while the shutter is open, through its sensor.

What a picture shows depends on the motion itself, so delay, rolling shutter and the blur of a moving camera are not
made from one still picture: the cell is drawn at the moments that the camera saw.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.effects.common.light import to_linear
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.render.backend import BackendName
from vispeg.render.camera import Camera
from vispeg.render.pipeline import Pipeline
from vispeg.robots.scene import Scene
from vispeg.vision.eye import recorded_of, values_of
from vispeg.vision.predict import Predictor, encoded
from vispeg.worlds.places import acts_on
from vispeg.worlds.split import optical
from vispeg.worlds.world import World

DRAWN = ("camera_delay", "rolling_shutter", "lens_distortion")  # in the picture before its sensor gets it
BANDS, EXPOSURES = 8, 5  # strips of a rolling shutter, moments of an open one
FINER = 3  # rays a pixel in each direction
DEPTH_UNIT = 1e-4  # m
SENSES = "encoder_offset"  # what joints read, not where they are

Path = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Shutter:
    """When a camera of a world looks.

    Attributes:
        delay: s from the middle of the exposure to the stamp.
        readout: s from the first row to the last.
        exposure: s that it is open.
    """

    delay: float
    readout: float
    exposure: float

    @classmethod
    def of(cls, world: World, camera: str) -> Shutter:
        """That of a camera in a world."""
        taken = (("camera_delay", "delay"), ("rolling_shutter", "readout"), ("motion_blur", "exposure"))
        return cls(*(values_of(world, name, camera).get(param, 0.0) for name, param in taken))

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Times, before the stamp is added, of each strip of rows (k,) and of each look within the exposure (m,), s."""
        strips = self.readout * ((np.arange(BANDS) + 0.5) / BANDS - 0.5) if self.readout else np.zeros(1)
        looks = self.exposure * ((np.arange(EXPOSURES) + 0.5) / EXPOSURES - 0.5) if self.exposure else np.zeros(1)
        return strips - self.delay, looks


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
    told: Callable[[float], None] = lambda share: None,
) -> Frames:
    """Pictures of a cell along a motion.

    Args:
        scene: the cell.
        cameras: as their user believes them; the frames state these, while `world` says what they are.
        world: looks, cameras, sensors, and where fixture and held part stand; without ranges.
        path: times (n,) s -> true joint angles (n, nj) rad.
        times: (n,) s, the stamps.
        seed: of what the sensors draw.
        backend, shadows: of the renderer.
        finer: rays a pixel in each direction, an odd number.
        told: is told which share is done.
    """
    scene = replace(scene, cameras=tuple(c.name for c in cameras))
    frames: list[RecordedFrame] = []
    with Predictor(scene, cameras, backend, shadows, finer) as predictor:
        predictor.see(world.only(lambda e: e.effect != SENSES))
        for k, camera in enumerate(cameras):
            shutter, sensor = Shutter.of(world, camera.name), _sensor(world, camera)
            recorded = recorded_of(camera, DEPTH_UNIT)
            for i, time in enumerate(times):
                rgb, depth = _exposed(predictor, camera.name, shutter, path, float(time))
                rgb, depth = _sensed(sensor, camera, rgb, depth, float(time), stream(seed, "frames", camera.name, i))
                frames.append(RecordedFrame(float(time), recorded, rgb, depth))
                told((k * len(times) + i + 1) / (len(cameras) * len(times)))
    frames.sort(key=lambda frame: frame.time)
    return Frames({frame.camera.name: frame.camera for frame in frames}, tuple(frames))


def _exposed(
    predictor: Predictor, camera: str, shutter: Shutter, path: Path, time: float
) -> tuple[np.ndarray, np.ndarray]:
    """Colour (H, W, 3) uint8 and depth (H, W) float32 m of one frame, each strip of rows at its own time."""
    strips, looks = shutter.moments()
    colours, depths = [], []
    for strip in strips:
        light, depth = None, None
        for number, q in enumerate(path(time + strip + looks)):
            seen = predictor.draw(camera, q)
            if number == len(looks) // 2:
                depth = seen.depth
            if len(looks) == 1:
                colours.append(seen.rgb)
                break
            part = to_linear(seen.rgb.astype(np.float32) / 255)
            light = part if light is None else light + part
        if light is not None:
            colours.append(encoded(light / len(looks)))
        depths.append(depth)
    if len(strips) == 1:
        return colours[0], depths[0]
    rows = np.minimum(np.arange(len(colours[0])) * len(strips) // len(colours[0]), len(strips) - 1)
    columns = np.arange(len(rows))
    return np.stack(colours)[rows, columns], np.stack(depths)[rows, columns]


def _sensor(world: World, camera: Camera) -> Pipeline:
    """What is left of a camera's effects once its pictures are drawn: the sensor, which may remember."""
    sensor = optical(world, [camera.name]).only(lambda e: effect(e.effect).family == "camera" and e.effect not in DRAWN)
    return Pipeline([replace(sensor, effects=tuple(_still(e, camera.name) for e in sensor.effects))], camera.name)


def _still(placed: EffectInstance, camera: str) -> EffectInstance:
    """Motion blur without the part that the moving camera makes: that is in the picture."""
    if placed.effect != "motion_blur" or not acts_on(placed.where, [camera]):
        return placed
    numbers = {name: value.value for name, value in placed.params.items()}
    return EffectInstance.of(placed.effect, placed.where, **{**numbers, "exposure": 0.0})


def _sensed(
    sensor: Pipeline, camera: Camera, rgb: np.ndarray, depth: np.ndarray, time: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    frame = Frame(
        rgb=rgb[None].astype(np.float32) / 255,
        depth=depth[None].copy(),
        K=camera.K[None],
        truth=depth[None],
        velocity=np.zeros((1, 6)),
        time=np.array([time]),
    )
    out = sensor.run(frame, [rng])
    if out.rgb is None or out.depth is None:
        raise ValueError("an effect took a picture away")
    delivered = np.nan_to_num(out.depth[0]).astype(np.float32)
    return np.round(255 * np.clip(out.rgb[0], 0, 1)).astype(np.uint8), delivered
