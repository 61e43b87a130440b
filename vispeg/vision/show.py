"""What a report shows of compared frames: the worst of them side by side, and residuals over image, distance, time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vispeg.render.image_kinds import depth_picture
from vispeg.vision.compare import Compared, summary
from vispeg.vision.photometry import LightResidual
from vispeg.vision.residuals import over_image_and_distance

WORST = 3  # frames of a camera that are shown
WIDEST = 480  # px of a picture on a page
DEPTH_SPAN = 0.01  # m, error of depth at which the colours of a difference end
PREDICTED, FOUND = (217, 84, 30), (10, 122, 117)  # of borders, as the page's colours of before and after


def pictures(compared: Sequence[Compared]) -> tuple[dict[str, object], dict[str, np.ndarray]]:
    """Return the record and the arrays of a comparison of pictures.

    Returns:
        `cameras` (their figures), `frames` (a row each, worst first), `shown` (which frame picture k is); and arrays
        `picture/k/NAME` (H, W, 3) uint8 and `camera/c/NAME`.
    """
    rows = [c.row() for c in compared]
    order = sorted(range(len(rows)), key=lambda i: -badness(rows[i]))
    cameras = summary(compared)
    arrays: dict[str, np.ndarray] = {}
    rows_drawn: list[dict[str, object]] = []
    for number, camera in enumerate(cameras):
        mine = [compared[i] for i in order if rows[i]["camera"] == camera["camera"]]
        for comparison in mine[:WORST]:
            arrays |= {f"picture/{len(rows_drawn)}/{name}": image for name, image in side_by_side(comparison).items()}
            rows_drawn.append(comparison.row())
        arrays |= {f"camera/{number}/{name}": values for name, values in over_image_and_distance(mine).items()}
    return {"cameras": cameras, "frames": [rows[i] for i in order], "shown": rows_drawn}, arrays


def badness(row: Mapping[str, Any]) -> float:
    """Return the error of a frame: of its borders in px where there are any, else of depth in mm, else grey levels."""
    return next((float(row[key]) for key in ("border_px", "depth_mm", "grey") if row[key] is not None), 0.0)


def side_by_side(comparison: Compared) -> dict[str, np.ndarray]:
    """Return pictures (H, W, 3) uint8 of a frame: predicted, measured with borders, difference; the same of depth."""
    out: dict[str, np.ndarray] = {}
    rgb, depth = comparison.frame.rgb, comparison.frame.depth
    if rgb is not None and comparison.light is not None:
        out = {
            "rendered": comparison.rendering.rgb,
            "measured": _with_borders(rgb, comparison),
            "difference": _difference(comparison.light),
        }
    if depth is not None and comparison.depth is not None:
        span = _span(comparison.rendering.depth)
        out["depth_rendered"], out["depth_measured"] = (
            depth_picture(z, *span) for z in (comparison.rendering.depth, depth)
        )
        out["depth_difference"] = _signed(comparison.depth.error, comparison.depth.missing)
    return {name: _small(image) for name, image in out.items()}


def _with_borders(rgb: np.ndarray, comparison: Compared) -> np.ndarray:
    """Return the measured picture with predicted borders, and a line from each to where it was found."""
    import cv2

    image = np.ascontiguousarray(rgb).copy()
    if comparison.displacements is None:
        return image
    found = np.isfinite(comparison.displacements.along)
    ends = comparison.borders.pixel + np.nan_to_num(comparison.displacements.along)[:, None] * comparison.borders.normal
    sub = 16  # OpenCV takes places in 16ths of a pixel, if it is given a shift of 4 bits
    for start, end, good in zip(comparison.borders.pixel, ends, found, strict=True):
        a, b = (tuple(np.rint(sub * p).astype(int).tolist()) for p in (start, end))
        if good:
            cv2.line(image, a, b, FOUND, 1, cv2.LINE_AA, 4)
        cv2.circle(image, a, sub // 2, PREDICTED, -1, cv2.LINE_AA, 4)
    return image


def _difference(light: LightResidual) -> np.ndarray:
    """Return measured minus predicted around grey; white where the picture is saturated."""
    off = np.clip(128 + np.nan_to_num(light.error), 0, 255).astype(np.uint8)
    return np.where(np.isnan(light.error), 255, off).astype(np.uint8)


def _signed(error: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """Return depth errors in colour: orange measured too near, teal too far, white none, black without a reading."""
    share = np.clip(np.nan_to_num(error) / DEPTH_SPAN, -1, 1)[..., None]
    white, near, far = (np.array(c, float) for c in ((255, 255, 255), PREDICTED, FOUND))
    image = white + np.where(share < 0, -share * (near - white), share * (far - white))
    return np.where(missing[..., None], 0, np.where(np.isnan(error)[..., None], 230, image)).astype(np.uint8)


def _span(depth: np.ndarray) -> tuple[float, float]:
    """Return the range of depth, m, that a picture's colours span."""
    readings = depth[depth > 0]
    low, high = np.quantile(readings, [0.01, 0.95]) if readings.size else (0.1, 1.0)
    return float(low), float(max(high, low + 0.05))


def _small(image: np.ndarray) -> np.ndarray:
    """Return the picture at most `WIDEST` wide."""
    import cv2

    height, width = image.shape[:2]
    if width <= WIDEST:
        return np.ascontiguousarray(image)
    return cv2.resize(image, (WIDEST, round(height * WIDEST / width)), interpolation=cv2.INTER_AREA)
