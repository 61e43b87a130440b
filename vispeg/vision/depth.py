"""The depth channel: measured less predicted distance, and the figures by which depth cameras are judged.

Interior pixels (away from every border) tell scale, bias and noise; the band along the borders tells fattened edges,
shadows and missing readings. The names of the figures are those of Intel's depth quality tool (librealsense,
tools/depth-quality, "Subpixel Linearity from an Affine Depth Pattern" and "Depth Quality Testing Methodology").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.vision.predict import Rendering

CLEAR = 5  # px from a border at which a pixel is interior
BAND = 3  # px to either side of a border
JUMP = 0.02  # share of the depth by which neighbours differ where there is an edge within a part
PLANE = 200  # interior pixels of a flat part that a plane needs
OUTLIERS = 0.005  # share of a plane's pixels at either end that are left out, as librealsense does
BASELINE = 0.05  # m, of the stereo pair that sub-pixel errors are stated for (RealSense D415: 55 mm, D435: 50 mm)


@dataclass(frozen=True, eq=False)
class DepthResidual:
    """One depth picture against its prediction, (H, W) each.

    Attributes:
        error: m, measured minus predicted; NaN where either has no reading.
        interior: bool, away from borders, with a prediction.
        band: bool, along a border.
        missing: bool, no reading where the prediction has one.
    """

    error: np.ndarray
    interior: np.ndarray
    band: np.ndarray
    missing: np.ndarray


def depth_residual(measured: np.ndarray, rendering: Rendering, clear: int = CLEAR, band: int = BAND) -> DepthResidual:
    """Subtract predicted from measured depth.

    Args:
        measured: (H, W) m, 0 = no reading.
        rendering: the prediction.
        clear, band: px from a border at which a pixel is interior, or belongs to the band.
    """
    import cv2

    predicted, surface = rendering.depth, rendering.depth > 0
    edge = np.zeros(surface.shape, bool)
    for axis in (0, 1):
        a, b = (np.moveaxis(x, axis, 0) for x in (rendering.parts, predicted))
        step = (a[1:] != a[:-1]) | (np.abs(b[1:] - b[:-1]) > JUMP * np.maximum(np.minimum(b[1:], b[:-1]), 1e-3))
        mark = np.moveaxis(edge, axis, 0)
        mark[1:] |= step
        mark[:-1] |= step
    off = cv2.distanceTransform((~edge).astype(np.uint8), cv2.DIST_L2, 5)
    error = np.where(surface & (measured > 0), measured - predicted, np.nan).astype(np.float32)
    return DepthResidual(error, surface & (off >= clear), surface & (off < band), surface & ~(measured > 0))


@dataclass(frozen=True)
class DepthQuality:
    """The figures of one depth picture, in librealsense's words; None where there is too little to tell.

    Attributes:
        fill_rate: % of the interior pixels that have a reading; None without interior pixels.
        z_accuracy: % of the distance, median of the signed error on the interior.
        plane_fit_rms: % of the distance, RMS off a plane fitted to the measured points of a flat part.
        plane_fit_rms_mm: the same in mm.
        subpixel_rms: px of disparity, the same for a stereo pair with a baseline of `BASELINE` and this focal length.
        distance: m, median.
    """

    fill_rate: float | None
    z_accuracy: float | None
    plane_fit_rms: float | None
    plane_fit_rms_mm: float | None
    subpixel_rms: float | None
    distance: float | None


def depth_quality(
    measured: np.ndarray, rendering: Rendering, residual: DepthResidual, flat: int | None
) -> DepthQuality:
    """Return the figures of one picture.

    Args:
        measured: (H, W) m, 0 = no reading.
        rendering: the prediction.
        residual: of the two.
        flat: the part whose surface is a plane (a table), counted as `Rendering.parts`; None where there is none.
    """
    inside, read = residual.interior, measured > 0
    both = inside & read
    fill = 100.0 * float(both.sum()) / int(inside.sum()) if inside.any() else None
    if not both.any():
        return DepthQuality(fill, None, None, None, None, None)
    accuracy = 100.0 * float(np.median(residual.error[both] / rendering.depth[both]))
    plane = both & (rendering.parts == flat) if flat is not None else np.zeros_like(both)
    off_plane: tuple[float | None, ...] = (None, None, None)
    if plane.sum() >= PLANE:
        off_plane = _plane(measured[plane].astype(float), rendering.eye.rays()[plane], rendering.eye.believed.fx)
    return DepthQuality(fill, accuracy, *off_plane, float(np.median(rendering.depth[both])))


def _plane(z: np.ndarray, rays: np.ndarray, focal: float) -> tuple[float, float, float]:
    """Return the RMS distance from a plane fitted to points z * rays: % of the distance, mm, and px of disparity.

    On a plane 1 / z is linear in the ray's X / Z and Y / Z, so that it is fitted where noise is even (disparity); the
    distance from the plane is taken along its normal.
    """
    design = np.concatenate([rays[:, :2], np.ones((len(z), 1))], 1)
    keep = np.ones(len(z), bool)
    for _ in range(2):
        solution = np.linalg.lstsq(design[keep], 1 / z[keep], rcond=None)[0]
        off = 1 / z - design @ solution
        low, high = np.quantile(off, [OUTLIERS, 1 - OUTLIERS])
        keep = (off >= low) & (off <= high)
    length = np.linalg.norm(solution)
    apart = (z[:, None] * rays) @ solution - 1  # times the distance of the plane from the camera
    rms = float(np.sqrt(np.mean(apart[keep] ** 2)) / length)
    return 100.0 * rms / float(np.median(z)), 1e3 * rms, float(np.sqrt(np.mean(off[keep] ** 2)) * focal * BASELINE)
