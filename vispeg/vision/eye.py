"""A camera with the errors of a world: calibrated pose and intrinsics, changed by the world's camera effects."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.lens import distort, undistort
from vispeg.core.rotation import quaternion
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.frames.frames import Frames
from vispeg.render.cameras.camera import PINHOLE, Camera
from vispeg.render.cameras.model_camera import cameras_of
from vispeg.robots.model import RobotModel
from vispeg.worlds.places import acts_on
from vispeg.worlds.world import World


@dataclass(frozen=True, eq=False)
class Eye:
    """A camera under the effects of a world.

    Attributes:
        camera: the true camera, with effects on pose and intrinsics applied.
        believed: the calibrated camera, about whose principal point `lens_distortion` acts.
        lens: (k1, k2, p1, p2, k3) of `lens_distortion`.
        delay: age of an image at its time stamp, s.
    """

    camera: Camera
    believed: Camera
    lens: tuple[float, ...] = PINHOLE
    delay: float = 0.0

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return the pixels (..., 2) of points (..., 3) in camera axes, m; NaN behind the camera."""
        pixels = self.camera.project(points)
        if not any(self.lens):
            return pixels
        centre, focal = self._belief()
        return distort((pixels - centre) / focal, self.lens) * focal + centre

    def ideal(self, pixels: np.ndarray) -> np.ndarray:
        """Return undistorted X/Z and Y/Z (..., 2) of pixels (..., 2); NaN outside the lens's image."""
        if any(self.lens):
            centre, focal = self._belief()
            pixels = undistort((pixels - centre) / focal, self.lens) * focal + centre
        return self.camera.ideal(pixels)

    def rays(self) -> np.ndarray:
        """Return the ray through each pixel's centre, (H, W, 3), in camera axes, scaled to z = 1."""
        if not any(self.lens):
            return self.camera.rays()
        size = self.camera.width, self.camera.height
        pixels = np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in size)), -1)
        return np.concatenate([self.ideal(pixels), np.ones((*pixels.shape[:2], 1))], -1)

    def finer(self, times: int) -> Eye:
        """Return the camera with `times` x `times` pixels per pixel."""
        return Eye(_finer(self.camera, times), _finer(self.believed, times), self.lens, self.delay)

    def _belief(self) -> tuple[np.ndarray, np.ndarray]:
        b = self.believed
        return np.array([b.cx, b.cy]), np.array([b.fx, b.fy])


def _finer(c: Camera, times: int) -> Camera:
    """Return a finer camera: pixel u becomes `times` pixels from times u on, with the same centre."""
    shift = (times - 1) / 2
    return c.moved(
        width=times * c.width,
        height=times * c.height,
        fx=times * c.fx,
        fy=times * c.fy,
        cx=times * c.cx + shift,
        cy=times * c.cy + shift,
    )


def camera_of(recorded: RecordedCamera) -> Camera:
    """Return a recorded camera as a renderer takes it. Raises UserError for one whose pose is not stated."""
    if recorded.mount is None or recorded.pose is None:
        what = f"camera '{recorded.name}' has no pose"
        raise UserError(what, key="frames/cameras.yaml", expected="base_T_camera or flange_T_camera (4 x 4, m)")
    return Camera(
        recorded.name,
        **recorded.lens,
        parent=recorded.mount,
        pos=tuple(recorded.pose[:3, 3].tolist()),
        quat=tuple(quaternion(_orthonormal(recorded.pose[:3, :3])).tolist()),
    )


def posed(frames: Frames, robot: RobotModel) -> Frames:
    """Return the frames with camera poses that the recording lacks taken from the robot's file.

    The recording states the cameras' sizes, so those in the robot's file need none.
    """
    bare = [name for name, camera in frames.cameras.items() if camera.pose is None]
    stated = [c for c in cameras_of(robot, (1, 1)) if c.name in bare and c.parent in ("base", "flange")]
    known = {c.name: recorded_of(c) for c in stated}
    if not known:
        return frames
    cameras = dict(frames.cameras)
    for name, camera in known.items():
        cameras[name] = replace(cameras[name], mount=camera.mount, pose=camera.pose)
    placed = tuple(replace(frame, camera=cameras[frame.camera.name]) for frame in frames.frames)
    return replace(frames, cameras=cameras, frames=placed)


def recorded_of(camera: Camera, depth_unit: float = 1e-4) -> RecordedCamera:
    """Return a camera on base or flange in the form of a recording, the inverse of `camera_of`."""
    if camera.parent not in ("base", "flange"):
        raise UserError(f"camera '{camera.name}' sits elsewhere", expected="base or flange", got=camera.parent)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera.rotation, camera.pos
    k1, k2, p1, p2, k3 = camera.distortion
    numbers = camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, (k1, k2, p1, p2, k3)
    return RecordedCamera(camera.name, *numbers, depth_unit, camera.parent, pose)


def values_of(world: World, effect: str, camera: str) -> dict[str, float]:
    """Return the parameters of an effect at a camera; empty if the world lacks it. The last of several counts."""
    placed = [e for e in world.effects if e.effect == effect and acts_on(e.where, [camera])]
    return _numbers(placed[-1]) if placed else {}


def lens_of(world: World, camera: str) -> tuple[float, ...]:
    """Return (k1, k2, p1, p2, k3) of the effect `lens_distortion` at a camera."""
    p = values_of(world, "lens_distortion", camera)
    return tuple(p.get(k, 0.0) for k in ("k1", "k2", "p1", "p2", "k3"))


def delay_of(world: World, camera: str) -> float:
    """Return the delay of a camera's images, s (effect `camera_delay`)."""
    return values_of(world, "camera_delay", camera).get("delay", 0.0)


def _numbers(placed: EffectInstance) -> dict[str, float]:
    return {name: float(value.value) for name, value in placed.params.items()}


def _orthonormal(matrix: np.ndarray) -> np.ndarray:
    """Return the nearest rotation to a matrix (3, 3) that was written with few digits."""
    u, _, v = np.linalg.svd(matrix)
    return u @ v
