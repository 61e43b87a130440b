"""Images with lens distortion, resampled from an undistorted image of twice the resolution that covers the view."""

from __future__ import annotations

import numpy as np

from vispeg.core.errors import UserError
from vispeg.render.backends.picture import Picture
from vispeg.render.cameras.camera import MAX_SIDE, PINHOLE, Camera

FINER = 2.0  # factor of resolution, so that parts of the image that the lens magnifies stay sharp; less if too large


class Warp:
    """Conversion of undistorted images to those of a camera with lens distortion.

    Attributes:
        pinhole: the camera without distortion whose images are converted.

    Raises:
        UserError: the lens is so wide that the undistorted image would be too large.
    """

    def __init__(self, camera: Camera):
        rays = camera.rays()
        low, high = rays[..., :2].min((0, 1)), rays[..., :2].max((0, 1))
        f, most = np.array([camera.fx, camera.fy]), MAX_SIDE // 2
        finer = min(FINER, (most - 4) / float((f * (high - low)).max()))
        if not finer >= 1:
            raise UserError("a lens too wide to draw", expected=f"up to {most} px", got=camera.distortion)
        f = finer * f
        size = np.ceil(f * (high - low)).astype(int) + 3  # one px to spare on each side
        centre = 1 - f * low
        self.pinhole = camera.moved(
            width=int(size[0]), height=int(size[1]), fx=f[0], fy=f[1], cx=centre[0], cy=centre[1], distortion=PINHOLE
        )
        self._map = (rays[..., :2] * f + centre).astype(np.float32)
        self._nearest = np.rint(self._map).astype(int)

    def __call__(self, picture: Picture) -> Picture:
        """Return the distorted picture: colour is interpolated; depth, ids and normals are of the nearest pixel."""
        import cv2

        rgb = cv2.remap(picture.rgb, self._map[..., 0], self._map[..., 1], cv2.INTER_LINEAR)
        return Picture(
            rgb,
            self.nearest(picture.depth),
            None if picture.ids is None else self.nearest(picture.ids),
            None if picture.normals is None else self.nearest(picture.normals),
        )

    def nearest(self, image: np.ndarray) -> np.ndarray:
        """Return an undistorted image (h, w, ...) with distortion, (H, W, ...): each pixel is the nearest one there."""
        return image[self._nearest[..., 1], self._nearest[..., 0]]
