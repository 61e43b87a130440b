"""Estimate vignetting from points of the room that several frames show at different distances from the centre.

The radiance of a matt surface does not depend on the viewpoint, so a fall towards the corners is due to the lens
(Goldman, Vignette and exposure calibration and compensation, TPAMI 32(12), 2010).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.identify.pictures.shots import Shot
from vispeg.vision.depth import depth_residual

APART = 10  # px, spacing of the points taken from each frame
SAME = (0.003, 0.01)  # m, and share of the distance: depth tolerance for the same point
DARK, FULL = 0.003, 0.95  # linear light: darker pixels are noisy, brighter ones saturated
LEAST = 40  # fewest points of a usable frame


@dataclass(frozen=True, eq=False)
class Links:
    """Observations of points of the room.

    Attributes:
        place: (n,) index of the point.
        frame: (n,) index of the frame that shows it.
        pixel: (n, 2) where, px.
        fall: (n,) 1 - cos^4 of the angle between view ray and optical axis.
        frames: number of frames.
    """

    place: np.ndarray
    frame: np.ndarray
    pixel: np.ndarray
    fall: np.ndarray
    frames: int

    def slopes(self, light: Sequence[np.ndarray]) -> np.ndarray:
        """Return the slope of log2 light over `fall` in each frame, (frames,); NaN for frames with too few points.

        Args:
            light: linear images (H, W), one per frame.
        """
        import cv2

        out = np.full(self.frames, np.nan)
        if not len(self.place):
            return out
        u, v = self.pixel.T
        smooth = [cv2.boxFilter(x, -1, (5, 5)) for x in light]
        level = np.array([smooth[f][b, a] for f, a, b in zip(self.frame, u, v, strict=True)])
        good = (level > DARK) & (level < FULL)
        octaves = np.log2(np.maximum(level, 1e-6))
        e, x = (self._against_others(y, good) for y in (octaves, self.fall))
        for f in range(self.frames):
            rows = good & (self.frame == f) & np.isfinite(e)
            if rows.sum() < LEAST:
                continue
            a, b = x[rows] - x[rows].mean(), e[rows] - np.median(e[rows])
            keep = np.abs(b) < 1.0  # a factor of two is a change of shadow, not vignetting
            spread = float(a[keep] @ a[keep])
            if spread > 0.003 * keep.sum():  # less variance of `fall` shows no slope
                out[f] = float(a[keep] @ b[keep]) / spread
        return out

    def _against_others(self, value: np.ndarray, good: np.ndarray) -> np.ndarray:
        """Return each value minus the mean of the same point in other frames, (n,); NaN if no other frame shows it."""
        n = int(self.place.max()) + 1
        count = np.bincount(self.place, good, n)[self.place] - good
        total = np.bincount(self.place, good * value, n)[self.place] - good * value
        return np.where(count > 0, value - total / np.maximum(count, 1), np.nan)


def links_of(shots: Sequence[Shot]) -> Links:
    """Take points of the room on a grid in each frame, and find their pixels in the other frames."""
    clear = [depth_residual(s.rendering.depth, s.rendering).interior & s.fixed for s in shots]
    rows: list[np.ndarray] = []
    start = 0
    for s, inside in zip(shots, clear, strict=True):
        height, width = inside.shape
        v, u = np.mgrid[APART // 2 : height : APART, APART // 2 : width : APART].reshape(2, -1)
        v, u = v[inside[v, u]], u[inside[v, u]]
        points = s.rendering.eye.rays()[v, u] * s.rendering.depth[v, u, None]
        room = points @ s.rendering.pose[:3, :3].T + s.rendering.pose[:3, 3]
        for number, (other, free) in enumerate(zip(shots, clear, strict=True)):
            in_camera = (room - other.rendering.pose[:3, 3]) @ other.rendering.pose[:3, :3]
            pixel = np.nan_to_num(other.rendering.eye.project(in_camera), nan=-1)
            at = np.rint(np.clip(pixel, -1, max(width, height))).astype(int)
            inner = (at >= 0).all(1) & (at < [width, height]).all(1) & (in_camera[:, 2] > 0)
            a, b = np.where(inner[:, None], at, 0).T
            near = np.abs(other.rendering.depth[b, a] - in_camera[:, 2]) < SAME[0] + SAME[1] * in_camera[:, 2]
            same = inner & near & free[b, a] & (other.rendering.parts[b, a] == s.rendering.parts[v, u])
            index = np.flatnonzero(same)
            rows.append(np.column_stack([index + start, np.full(len(index), number), at[index]]))
        start += len(v)
    table = np.concatenate(rows) if rows else np.zeros((0, 4), int)
    secant = [np.sum(s.rendering.eye.rays() ** 2, -1) for s in shots]  # 1 / cos^2 of each pixel's view angle
    fall = np.array([1 - 1 / secant[f][b, a] ** 2 for _, f, a, b in table])
    return Links(table[:, 0], table[:, 1], table[:, 2:], fall, len(shots))
