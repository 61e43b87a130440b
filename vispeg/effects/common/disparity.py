"""Disparity, the quantity in which a stereo matcher errs: d = f B / z, in px of the matcher's own image.

The matcher's focal length is a parameter: a frame rendered at 64 px is a crop or a coarser copy of an image that the
sensor matched at its native size, and has the errors of the native size. Source: Gallup, Frahm, Mordohai and Pollefeys,
Variable baseline/resolution stereo, CVPR 2008, eq. (1) and (2).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Values
from vispeg.core.params import Param
from vispeg.effects.common.camera import column

BASELINE = Param(0.05, 0.005, 0.3, "m", start=0.05, shape=True, doc="stereo baseline")
FOCAL = Param(425.0, 50.0, 3000.0, "px", start=425.0, shape=True, doc="focal length of the matcher's native image")
PARAMS = {"baseline": BASELINE, "focal": FOCAL}


def focal_baseline(p: Values, rows: np.ndarray) -> np.ndarray:
    """Return focal length times baseline of these images, px m, shape (len(rows), 1, 1)."""
    return column(np.asarray(p["baseline"]) * np.asarray(p["focal"]), rows, 2)


def disparity(depth: np.ndarray, fb: np.ndarray | np.float32) -> np.ndarray:
    """Return the disparity f B / z in px; 0 (a point at infinity) where depth is 0."""
    return np.divide(fb, depth, out=np.zeros_like(depth), where=depth > 0)


def displaced(depth: np.ndarray, change: np.ndarray, fb: np.ndarray) -> np.ndarray:
    """Return the depth after the disparity changed by `change` px: z / (1 + change z / (f B)).

    It is 0 (no reading) where depth was 0, and where less than a tenth of the disparity is left.
    """
    factor = change * depth
    factor /= fb
    factor += np.float32(1)
    return np.divide(depth, factor, out=np.zeros_like(depth), where=factor > np.float32(0.1))


def truth(frame) -> np.ndarray:
    """Return depth as rendered (n, H, W), m: the frame's `truth`, else its `depth`, of which it has one."""
    return frame.depth if frame.truth is None else frame.truth
