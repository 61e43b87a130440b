"""Predict what a camera sees at measured joint angles: colour, depth, and which part each pixel shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.effects.common.light import to_linear, to_srgb
from vispeg.render.backends.backend import BackendName, Renderer
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.render.look import dress
from vispeg.robots.scene import Scene
from vispeg.vision.eye import Eye
from vispeg.vision.geometry import Geometry
from vispeg.worlds.split import optical
from vispeg.worlds.world import World

TO_LINEAR = to_linear(np.arange(256, dtype=np.float32) / 255)  # linear light of each 8-bit sRGB value
TIMED = ("camera_delay", "dropped_frames")  # what a picture of one moment cannot show


@dataclass(frozen=True, eq=False)
class Rendering:
    """One predicted picture.

    Attributes:
        eye: the camera as its world makes it, and as calibrated (`eye.believed`).
        q: (nj,) rad, the measured angles that it is predicted at.
        rgb: (H, W, 3) uint8 sRGB, in the predictor's look.
        depth: (H, W) float32, planar, m, 0 where nothing is.
        parts: (H, W) int32, 0 for nothing, else 1 + the part's place among the scene's parts.
        pose: (4, 4) camera axes (OpenCV) in the base frame, m.
    """

    eye: Eye
    q: np.ndarray
    rgb: np.ndarray
    depth: np.ndarray
    parts: np.ndarray
    pose: np.ndarray


class Predictor:
    """A renderer of a cell as its cameras see it in a world, which `see` changes. Close it after use.

    Args:
        scene: the cell.
        cameras: as calibrated, at the base or the flange.
        backend, shadows: of the renderer.
        finer: rays per pixel in each direction, an odd number: colour is the mean of their light, depth and part are
            those of the ray through the centre.
        beside: adds to a picture what the cell's model does not have.

    Attributes:
        geometry: where everything stands; `draw` moves it.
        world: the present one, with the effects that the cell states.
    """

    def __init__(
        self,
        scene: Scene,
        cameras: Sequence[Camera],
        backend: BackendName = "auto",
        shadows: bool = False,
        finer: int = 1,
        beside: Callable[[Rendering], Rendering] = lambda picture: picture,
    ):
        if finer < 1 or finer % 2 == 0:
            raise ValueError(f"an odd number of rays, not {finer}")
        self.finer, self._beside = finer, beside
        self.cameras = {c.name: c for c in cameras}
        self.geometry = Geometry(scene, cameras)
        self.scene = self.geometry.scene
        self._renderer = Renderer(self.scene, list(cameras)[:1], backend, labels=True, shadows=shadows)
        self.world = self.geometry.world
        self._dressed: tuple[World, dict[str, tuple[float, ...]]] | None = None

    @property
    def backend(self) -> str:
        """Name of the renderer at work."""
        return self._renderer.backend

    def see(self, world: World) -> None:
        """Set the world to predict: its looks, cameras, lenses, and where fixture and held part stand."""
        self.geometry.place(world)
        self.world = world = self.geometry.world
        looks = world.only(lambda e: effect(e.effect).family == "appearance")
        bodies = self.geometry.bodies if looks.effects else {}  # distractors are placed clear of bodies
        wanted = looks, {name: tuple(pose) for name, pose in bodies.items()}
        if wanted != self._dressed:
            dress(self._renderer, self.scene, looks, bodies)
            self._dressed = wanted

    def draw(self, camera: str, q: np.ndarray) -> Rendering:
        """Return what a camera sees at measured joint angles q (nj,) rad, before any effect of its sensor."""
        geometry, eye = self.geometry, self.geometry.eyes[camera]
        geometry.at(np.asarray(q, float))
        drawn = eye if self.finer == 1 else eye.finer(self.finer)
        if self._renderer.cameras != (drawn.camera,):
            self._renderer.aim([drawn.camera])
        shot = self._renderer.render(geometry.data.qpos, geometry.bodies)[camera]
        rgb, depth, parts = shot.rgb, shot.depth, shot.segmentation
        assert parts is not None  # it was made with labels
        if any(eye.lens):
            rgb, depth, parts = _bent(drawn, rgb, depth, parts)
        if self.finer > 1:
            rgb, depth, parts = _coarser(rgb, depth, parts, self.finer)
        return self._beside(Rendering(eye, np.array(q, float), rgb, depth, parts, shot.pose))

    def sensed(
        self, rendering: Rendering, seed: int, velocity: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the picture that the world's sensor gives: rgb (H, W, 3) uint8 and depth (H, W) float32 m, 0 = none.

        Args:
            rendering: of this predictor, in its present world.
            seed: of the sensor's random numbers.
            velocity: (6,) m/s, rad/s of the camera in its own axes, for motion blur; at rest if not given.
        """
        return through_sensor(self.world, rendering, seed, velocity, bend=False)

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()

    def __enter__(self) -> Predictor:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


def through_sensor(
    world: World, rendering: Rendering, seed: int, velocity: np.ndarray | None = None, bend: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Return a rendered picture after the image effects of a world; those of time (delay, dropped frames) are left out.

    Args:
        world: without ranges.
        rendering: what was drawn.
        seed: of the sensor's random numbers.
        velocity: (6,) m/s and rad/s of the camera in its own axes.
        bend: whether the lens's distortion is among the effects, or in the picture already.
    """
    name = rendering.eye.believed.name
    skipped = TIMED if bend else (*TIMED, "lens_distortion")
    sensor = optical(world, [name]).only(lambda e: effect(e.effect).family == "camera" and e.effect not in skipped)
    return delivered(Pipeline([sensor], name), rendering, stream(seed, "frames", name), velocity)


def delivered(
    sensor: Pipeline,
    rendering: Rendering,
    rng: np.random.Generator,
    velocity: np.ndarray | None = None,
    time: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return a picture as a sensor delivers it: (H, W, 3) uint8, and depth (H, W) m, 0 where it has no reading.

    Args:
        sensor: of the camera; it may have state.
        rendering: what was drawn.
        rng: for the sensor's random numbers.
        velocity: (6,) m/s and rad/s of the camera in its own axes; at rest if not given.
        time: of the picture, s.
    """
    frame = Frame(
        rgb=rendering.rgb[None].astype(np.float32) / 255,
        depth=rendering.depth[None].copy(),
        K=rendering.eye.believed.K[None],
        truth=rendering.depth[None],
        velocity=np.zeros((1, 6)) if velocity is None else np.asarray(velocity, float)[None],
        time=np.array([time]),
    )
    out = sensor.run(frame, [rng])
    if out.rgb is None or out.depth is None:
        raise ValueError("an effect took a picture away")
    rgb = np.round(255 * np.clip(out.rgb[0], 0, 1)).astype(np.uint8)
    return rgb, np.nan_to_num(out.depth[0]).astype(np.float32)


def _coarser(rgb: np.ndarray, depth: np.ndarray, parts: np.ndarray, times: int) -> tuple[np.ndarray, ...]:
    """Return pixels of `times` x `times` rays: the mean of their light, depth and part of the middle one."""
    height, width = depth.shape[0] // times, depth.shape[1] // times
    light = TO_LINEAR[rgb].reshape(height, times, width, times, 3).mean(axis=(1, 3))
    middle = slice(times // 2, None, times)
    return encoded(light), depth[middle, middle].copy(), parts[middle, middle].copy()


def encoded(light: np.ndarray) -> np.ndarray:
    """Return linear light in [0, 1] as uint8 sRGB."""
    return np.round(255 * to_srgb(light)).astype(np.uint8)


def _bent(eye: Eye, rgb: np.ndarray, depth: np.ndarray, parts: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return pictures as the lens of `eye` shows them: colour interpolated, depth and parts from the nearest pixel."""
    import cv2

    c = eye.camera
    where = eye.rays()[..., :2]
    at = c.project(np.concatenate([where, np.ones((*where.shape[:2], 1))], -1))
    u, v = (np.nan_to_num(at[..., i], nan=-1e4).astype(np.float32) for i in (0, 1))
    colour = cv2.remap(rgb, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    near = (cv2.remap(x, u, v, cv2.INTER_NEAREST, borderValue=0) for x in (depth, parts.astype(np.float32)))
    distance, labels = near
    return colour, distance, np.rint(labels).astype(np.int32)
