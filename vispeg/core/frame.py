"""The data that pass through a camera's pipeline: a stack of images of one camera, with calibration and times."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Frame:
    """n images of one camera. Effects of family `camera` change them in place or replace their arrays.

    Attributes:
        rgb: (n, H, W, 3) float32 in [0, 1], sRGB-encoded; None without colour.
        depth: (n, H, W) float32, planar distance along the optical axis in m, 0 = no reading; or None.
        K: (n, 3, 3) intrinsics in px that the user believes in, pixel centres at integer coordinates.
        truth: (n, H, W) float32 depth as rendered, m, which no effect changes; or None. For effects that depend on the
            geometry of the scene, also where no depth is delivered.
        colour: (n, H, W, 3) float32 colour as rendered, which no effect changes; or None. For effects on depth that
            depend on the light, also where no colour is delivered.
        normals: (n, H, W, 3) float32 surface normals in the camera's OpenCV axes; None if the renderer gives none.
        velocity: (n, 6) linear (m/s) and angular (rad/s) velocity of the camera in its own OpenCV axes, or None.
        bodies: (n, H, W) number of the body that each pixel shows as rendered, which no effect changes; None if all
            that is seen is at rest.
        twists: (n, bodies, 6) as `velocity`, relative to each body; None without `bodies`.
        time: (n,) s since the episode began, for latency and dropped frames.
        parts: (n, H, W) number of the part that each pixel shows, 0 = none, moved with the pixels; or None.
        shown: (n,) s, time at which each image was taken: `time`, or earlier for a late image; or None.
    """

    rgb: np.ndarray | None
    depth: np.ndarray | None
    K: np.ndarray
    truth: np.ndarray | None = None
    colour: np.ndarray | None = None
    normals: np.ndarray | None = None
    velocity: np.ndarray | None = None
    bodies: np.ndarray | None = None
    twists: np.ndarray | None = None
    time: np.ndarray = field(default_factory=lambda: np.zeros(1))
    parts: np.ndarray | None = None
    shown: np.ndarray | None = None

    @property
    def n(self) -> int:
        """Number of images in the stack."""
        return len(self.K)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        image = self.rgb if self.rgb is not None else self.depth
        if image is None:
            raise ValueError("a frame without an image")
        return image.shape[1], image.shape[2]
