"""What a sensor does to a picture, as a few robust figures a frame: of depth, and of light.

Where the borders fit, the rendered picture passes through the sensor that a world says, and the same figures are taken
of it as of the measured one. So every effect that has an `image` is compared without a formula of its own (the method
of simulated moments, McFadden, Econometrica 57(5), 1989). Colours and lights of a cell are not known, so of light only
what does not depend on them counts, or what all parts agree on.
"""

from __future__ import annotations

import numpy as np

from vispeg.effects.common.light import to_linear
from vispeg.vision.borders import Borders
from vispeg.vision.depth import depth_residual
from vispeg.vision.predict import Seen

NEARER = np.array([0.12, 0.18, 0.25, 0.35, 0.5, 0.8])  # m: edges of the bins of distance
STEP = 0.03  # m by which the far side of a border lies behind for near things to grow over it
REACH = 8  # px beside a border
FEW = 40  # pixels that a figure needs
QUIET = 0.1  # quantile of local scatter: a texture is not noise
EDGES = 30  # border points that a width needs


def depth_figures(measured: np.ndarray, seen: Seen) -> np.ndarray:
    """(k,) of one depth picture (H, W) m; NaN where it shows too little.

    For each bin of distance: median error and its slopes across and down the image as shares of the distance, and the
    log of the scatter between neighbours. Then the share of holes inside parts and their mean run in px; beside
    borders, by px from 1 to REACH on the far side, the share that reads the near part, and the share of holes.
    """
    found = depth_residual(measured, seen)
    height, width = measured.shape
    x = (np.arange(width) - (width - 1) / 2) / width * np.ones((height, 1))
    y = (np.arange(height)[:, None] - (height - 1) / 2) / width * np.ones((1, width))
    out, kind = [], np.digitize(seen.depth, NEARER)
    apart = np.full(measured.shape, np.nan)
    apart[:, 1:] = np.abs(found.error[:, 1:] - found.error[:, :-1])
    for k in range(len(NEARER) + 1):
        rows = found.interior & (kind == k) & np.isfinite(found.error)
        if rows.sum() < FEW:
            out += [np.nan] * 4
            continue
        error, z = found.error[rows], seen.depth[rows]
        out.append(float(np.median(error / z)))
        for along in (x, y):
            left, right = along[rows] < np.median(along[rows]), along[rows] >= np.median(along[rows])
            both = left.sum() > FEW / 4 and right.sum() > FEW / 4
            out.append(float(np.median(error[right]) - np.median(error[left])) if both else np.nan)
        steps = apart[rows]
        steps = steps[np.isfinite(steps)]
        out.append(float(np.log(np.mean(steps[steps <= np.quantile(steps, 0.9)]) + 1e-4)) if len(steps) else np.nan)
    inside = found.interior
    lost = inside & (measured <= 0)
    out.append(float(lost.sum() / max(inside.sum(), 1)))
    starts = lost[:, 1:] & ~lost[:, :-1]
    out.append(float(lost.sum() / starts.sum()) if starts.sum() > 5 else np.nan)
    return np.concatenate([out, _beside(measured, seen)])


def _beside(measured: np.ndarray, seen: Seen) -> np.ndarray:
    """(2 REACH,) shares that read the near part, and of holes, by distance from a border on its far side."""
    import cv2

    true = np.where(seen.depth > 0, seen.depth, 8.0).astype(np.float32)
    grown = np.ones((3, 3), np.uint8)
    front, near = true, np.zeros((2, REACH))
    done = np.zeros(true.shape, bool)
    for px in range(REACH):
        front = cv2.erode(front, grown)
        band = (true - front > STEP) & ~done & (seen.depth > 0)
        done |= band
        count = max(int(band.sum()), 1)
        middle = (true + front) / 2
        near[0, px] = float(((measured > 0) & (measured < middle))[band].sum() / count)
        near[1, px] = float((measured <= 0)[band].sum() / count)
    return near.ravel()


def light_figures(picture: np.ndarray, seen: Seen, borders: Borders, flow: np.ndarray | None) -> np.ndarray:
    """(8,) of one picture (H, W, 3) uint8: logarithms of light, red and blue against the prediction, the median over
    parts; fall-off towards the corners; squared width of edges in px across and down, and along against across the
    image's motion; the log of noise in dark and in bright places.

    Args:
        picture: as measured or modelled.
        seen: the prediction in the predictor's look.
        borders: of the prediction.
        flow: (2,) px/s at the image's centre, or None.
    """
    light, known = (to_linear(p.astype(np.float32) / 255) for p in (picture, seen.rgb))
    clear = depth_residual(np.ones(seen.depth.shape), seen).interior
    height, width = seen.depth.shape
    camera = seen.eye.believed
    x, y = (np.arange(width) - camera.cx) / camera.fx, (np.arange(height)[:, None] - camera.cy) / camera.fy
    fall = 1 - 1 / (1 + x * x + y * y) ** 2
    ratios, slopes = [], []
    for part in np.unique(seen.parts):
        rows = clear & (seen.parts == part) & (light.max(-1) < 0.98) & (known.min(-1) > 1e-3)
        if part == 0 or rows.sum() < 10 * FEW:
            continue
        log = np.log2(np.maximum(light[rows], 1e-4)) - np.log2(known[rows])
        middle = np.median(log, 0)
        ratios.append([middle[1], middle[0] - middle[1], middle[2] - middle[1]])
        f, g = fall[rows] - fall[rows].mean(), log[:, 1] - log[:, 1].mean()
        slopes.append([float(f @ g), float(f @ f)])
    shade = np.sum(slopes, 0) if slopes else np.zeros(2)
    mean = np.median(ratios, 0) if ratios else np.full(3, np.nan)
    return np.concatenate(
        [
            mean,
            [shade[0] / shade[1] if shade[1] > 1 else np.nan],
            _widths(light[..., 1], borders, flow),
            _grain(light[..., 1], clear),
        ]
    )


def _widths(light: np.ndarray, borders: Borders, flow: np.ndarray | None) -> np.ndarray:
    """(2,) median squared spread of edges in px^2, and how much more of it lies along the motion than across."""
    import cv2

    strength = []
    for sigma in (1.0, 2.0):
        x = np.arange(-8, 9) / 1.0
        kernel = -x * np.exp(-0.5 * (x / sigma) ** 2) / sigma**2
        smooth = np.exp(-0.5 * (x / 1.0) ** 2)
        kernel, smooth = kernel / np.abs(kernel).sum() * 2, smooth / smooth.sum()
        gx, gy = cv2.sepFilter2D(light, -1, kernel, smooth), cv2.sepFilter2D(light, -1, smooth, kernel)
        u, v = np.rint(borders.pixel).astype(int).T if len(borders) else (np.zeros(0, int),) * 2
        best = np.zeros(len(borders))
        for off in (-2, -1, 0, 1, 2):
            at = np.rint(borders.pixel + off * borders.normal).astype(int) if len(borders) else np.zeros((0, 2), int)
            u, v = np.clip(at[:, 0], 0, light.shape[1] - 1), np.clip(at[:, 1], 0, light.shape[0] - 1)
            best = np.maximum(best, np.hypot(gx[v, u], gy[v, u]))
        strength.append(best)
    good = (strength[1] > 0.05) & (borders.free.min(1) > 6) if len(borders) else np.zeros(0, bool)
    if good.sum() < EDGES:
        return np.full(2, np.nan)
    share = np.clip((strength[0][good] / strength[1][good]) ** 2, 0.26, 0.98)
    square = (4 * share - 1) / (1 - share) / 3  # of the edge's spread, up to a constant of the filters
    out = [float(np.median(square)), np.nan]
    if flow is not None and np.linalg.norm(flow) > 20:
        cosine = (borders.normal[good] @ (flow / np.linalg.norm(flow))) ** 2
        along, across = cosine > 0.7, cosine < 0.3
        if min(along.sum(), across.sum()) > EDGES / 3:
            out[1] = float(np.median(square[along]) - np.median(square[across]))
    return np.array(out)


def _grain(light: np.ndarray, clear: np.ndarray) -> np.ndarray:
    """(2,) log of the local scatter in the quietest places of the darker and of the brighter half."""
    import cv2

    mask = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
    rough = cv2.boxFilter(cv2.filter2D(light, -1, mask) ** 2, -1, (9, 9))
    level = cv2.boxFilter(light, -1, (9, 9))
    inside = cv2.erode(clear.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    if inside.sum() < 10 * FEW:
        return np.full(2, np.nan)
    half = np.median(level[inside])
    pick = [rough[inside & (level <= half)], rough[inside & (level > half)]]
    return np.array([0.5 * np.log(np.quantile(p, QUIET) + 1e-6) if len(p) > FEW else np.nan for p in pick])
