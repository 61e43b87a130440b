"""A calibrated camera: intrinsics, lens distortion and pose.

Camera axes are OpenCV's: x right, y down, z along the optical axis.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.core.lens import distort, undistort
from vispeg.core.rotation import quaternion

MAX_SIDE = 8192  # px
PINHOLE = (0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with Brown's lens distortion. Pixel centres have integer coordinates, (0, 0) at the top left.

    Attributes:
        name: the camera's name in shots and files.
        width, height: size of the image, px.
        fx, fy: focal length, px.
        cx, cy: principal point, px; the centre of the image is ((width - 1) / 2, (height - 1) / 2).
        distortion: (k1, k2, p1, p2, k3).
        parent: frame that the camera is fixed to: `base` (the world frame), or a site or body of the model such as
            `flange`.
        pos: (3,) optical centre in the parent's frame, m.
        quat: (4,) w, x, y, z, orientation of the camera axes in the parent's frame.

    Raises:
        UserError: the intrinsics, the lens distortion or the pose are impossible.
    """

    name: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = PINHOLE
    parent: str = "base"
    pos: tuple[float, ...] = (0.0, 0.0, 0.0)
    quat: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for key, size in (("distortion", 5), ("pos", 3), ("quat", 4)):
            object.__setattr__(self, key, self._numbers(key, getattr(self, key), size))
        for key in ("fx", "fy", "cx", "cy"):
            object.__setattr__(self, key, self._numbers(key, [getattr(self, key)], 1)[0])
        for key in ("width", "height"):
            value = getattr(self, key)
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 1 <= value <= MAX_SIDE:
                raise self._wrong(key, f"a whole number of px from 1 to {MAX_SIDE}", value)
            object.__setattr__(self, key, int(value))
        for key, side in (("fx", self.width), ("fy", self.height)):
            value = getattr(self, key)
            if not 0.02 * side <= value <= 1000 * side:  # half angles of 87.7 and 0.03 degrees
                raise self._wrong(key, f"between {0.02 * side:g} and {1000 * side:g} px", value)
        for key, side in (("cx", self.width), ("cy", self.height)):
            value = getattr(self, key)
            if not -side <= value <= 2 * side:
                raise self._wrong(key, f"a principal point within {-side} to {2 * side} px", value)
        for key in ("name", "parent"):
            if not isinstance(getattr(self, key), str) or not getattr(self, key):
                raise self._wrong(key, "a name", getattr(self, key))
        norm = float(np.linalg.norm(self.quat))
        if abs(norm - 1) > 1e-3:
            raise self._wrong("quat", "a unit quaternion (w, x, y, z)", self.quat)
        object.__setattr__(self, "quat", tuple(value / norm for value in self.quat))
        if any(self.distortion):
            u, v = np.linspace(-0.5, self.width - 0.5, 9), np.linspace(-0.5, self.height - 0.5, 9)
            if not np.isfinite(self.ideal(np.stack(np.meshgrid(u, v), -1))).all():
                raise self._wrong("distortion", "a lens in which each pixel has one viewing direction", self.distortion)

    @property
    def K(self) -> np.ndarray:
        """(3, 3) intrinsics, px."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) rotation whose columns are the camera axes in the parent's frame."""
        return rotation(self.quat)

    def moved(self, **changes: Any) -> Camera:
        """Return a copy of the camera with some fields changed."""
        return replace(self, **changes)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Project points (..., 3) in camera axes, m, to pixels (..., 2); NaN for points behind the camera."""
        points = np.asarray(points, float)
        z = np.where(points[..., 2:] > 0, points[..., 2:], np.nan)
        xy = distort(points[..., :2] / z, self.distortion)
        return xy * (self.fx, self.fy) + (self.cx, self.cy)

    def rays(self) -> np.ndarray:
        """Return the viewing ray (H, W, 3) of each pixel centre, in camera axes, scaled to z = 1, read only.

        Lens distortion is taken into account: the rays are those along which light arrives.
        """
        # cached for cameras of any name and pose
        return _rays(self.moved(name="any", parent="any", pos=(0, 0, 0), quat=(1, 0, 0, 0)))

    def points(self, depth: np.ndarray) -> np.ndarray:
        """Return the points (H, W, 3) in camera axes, m, of planar depth (H, W) in m; (0, 0, 0) where depth is 0."""
        return self.rays() * np.asarray(depth, float)[..., None]

    def ideal(self, pixels: np.ndarray) -> np.ndarray:
        """Return the undistorted X/Z and Y/Z (..., 2) of pixels (..., 2); NaN where distortion has no inverse."""
        return undistort((pixels - (self.cx, self.cy)) / (self.fx, self.fy), self.distortion)

    def _numbers(self, key: str, value: Any, size: int) -> tuple[float, ...]:
        try:
            values = np.asarray(value, float).reshape(-1)
        except (TypeError, ValueError):
            values = np.array([np.nan])
        if len(values) != size or not np.isfinite(values).all():
            raise self._wrong(key, count(size, "finite number"), value)
        return tuple(values.tolist())

    def _wrong(self, key: str, expected: str, got: Any) -> UserError:
        return UserError(f"camera '{self.name}' has an impossible {key}", expected=expected, got=got)


FIELDS = tuple(f.name for f in fields(Camera))


@lru_cache(maxsize=64)
def _rays(camera: Camera) -> np.ndarray:
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1)
    out = np.concatenate([camera.ideal(pixels), np.ones((camera.height, camera.width, 1))], -1)
    out.flags.writeable = False
    return out


def rotation(quat: tuple[float, ...] | np.ndarray) -> np.ndarray:
    """Return the (3, 3) rotation matrix of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quat
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def looking_at(pos: np.ndarray, target: np.ndarray, up: np.ndarray) -> tuple[float, ...]:
    """Return the orientation (4,) w, x, y, z of a camera that looks at a target.

    Args:
        pos: (3,) optical centre, m.
        target: (3,) point on the optical axis, m.
        up: (3,) direction that appears upwards in the image.

    Raises:
        UserError: `up` is parallel to the viewing direction, or the target is at `pos`.
    """
    forward = np.subtract(target, pos).astype(float)
    right = np.cross(forward, up)
    if not np.linalg.norm(right) > 1e-9:
        raise UserError("a camera cannot look along its own 'up'", got=(tuple(pos), tuple(target), tuple(up)))
    z, x = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
    return tuple(quaternion(np.column_stack([x, np.cross(z, x), z])).tolist())
