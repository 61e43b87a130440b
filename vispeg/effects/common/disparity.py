"""Disparity, the quantity in which a stereo matcher errs: d = f B / z, in px of the matcher's own image.

The matcher's focal length is a parameter of its own: a frame rendered at 64 px stands for part of, or a coarser copy
of, what a sensor matched at its native size, and its errors are those of the native size. Source: Gallup, Frahm,
Mordohai and Pollefeys, Variable baseline/resolution stereo, CVPR 2008, eq. (1) and (2).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Values
from vispeg.core.params import Param
from vispeg.effects.common.camera import column

BASELINE = Param(0.05, 0.005, 0.3, "m", start=0.05, shape=True, doc="stereo baseline")
FOCAL = Param(425.0, 50.0, 3000.0, "px", start=425.0, shape=True, doc="focal length of the matcher's native image")
PARAMS = {"baseline": BASELINE, "focal": FOCAL}


def gauge(p: Values, rows: np.ndarray) -> np.ndarray:
    """Focal length times baseline of some images, px m, shape (len(rows), 1, 1)."""
    return column(np.asarray(p["baseline"]) * np.asarray(p["focal"]), rows, 2)


def disparity(depth: np.ndarray, fb: np.ndarray | np.float32) -> np.ndarray:
    """Disparity f B / z in px; 0 (a point at infinity) where depth is 0."""
    return np.divide(fb, depth, out=np.zeros_like(depth), where=depth > 0)


def displaced(depth: np.ndarray, change: np.ndarray, fb: np.ndarray) -> np.ndarray:
    """Depth after the disparity changed by `change` px: z / (1 + change z / f B); 0 where none or infinity is left.

    A disparity that shrinks below a tenth of itself is no match any more: such a pixel is lost.
    """
    factor = change * depth
    factor /= fb
    factor += np.float32(1)
    return np.divide(depth, factor, out=np.zeros_like(depth), where=factor > np.float32(0.1))


def truth(frame) -> np.ndarray:
    """Depth as rendered (n, H, W), m; the frame's own depth where nobody kept the truth."""
    return frame.depth if frame.truth is None else frame.truth
