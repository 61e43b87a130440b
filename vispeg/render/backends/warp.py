"""Pictures through a lens with distortion: a pinhole picture twice as fine that holds all of it, looked up by ray."""

from __future__ import annotations

import numpy as np

from vispeg.core.errors import UserError
from vispeg.render.backends.picture import Picture
from vispeg.render.cameras.camera import MAX_SIDE, PINHOLE, Camera

FINER = 2.0  # times the resolution, so that a lens that magnifies somewhere does not blur


class Warp:
    """The pinhole camera behind a distorted one, and the way back. Raises UserError for a lens too wide to draw."""

    def __init__(self, camera: Camera):
        rays = camera.rays()
        low, high = rays[..., :2].min((0, 1)), rays[..., :2].max((0, 1))
        f = FINER * np.array([camera.fx, camera.fy])
        size = np.ceil(f * (high - low)).astype(int) + 3  # one px to spare on each side
        if size.max() > MAX_SIDE // 2:
            raise UserError("a lens too wide to draw", expected=f"up to {MAX_SIDE // 2} px", got=camera.distortion)
        centre = 1 - f * low
        self.pinhole = camera.moved(
            width=int(size[0]), height=int(size[1]), fx=f[0], fy=f[1], cx=centre[0], cy=centre[1], distortion=PINHOLE
        )
        self._map = (rays[..., :2] * f + centre).astype(np.float32)
        self._nearest = np.rint(self._map).astype(int)

    def __call__(self, picture: Picture) -> Picture:
        """Give the picture as the lens shows it: colour interpolated, depth, ids and normals from the nearest ray."""
        import cv2

        u, v = self._nearest[..., 0], self._nearest[..., 1]
        rgb = cv2.remap(picture.rgb, self._map[..., 0], self._map[..., 1], cv2.INTER_LINEAR)
        return Picture(
            rgb,
            picture.depth[v, u],
            None if picture.ids is None else picture.ids[v, u],
            None if picture.normals is None else picture.normals[v, u],
        )
