"""Read a camera's lens from a ROS 1 or ROS 2 CameraInfo message."""

from __future__ import annotations

from typing import Any

import numpy as np

from vispeg.core.errors import UserError

MODELS = ("plumb_bob", "rational_polynomial")


def lens_of(info: Any, rectified: bool, **where: Any) -> tuple[list[float], tuple[float, float, float, float, float]]:
    """Return fx, fy, cx, cy, px, and Brown's k1, k2, p1, p2, k3 of the pictures that a CameraInfo message describes.

    Args:
        info: the message.
        rectified: whether the pictures were rectified: matrix P then applies, and no distortion.
        where: `file` or `key` of errors.

    Raises:
        UserError: not calibrated, a lens that Brown's model does not express, or binning or a region of interest.
    """
    K, D, P = (np.ravel(getattr(info, name, getattr(info, name.upper(), ()))).astype(float) for name in "kdp")
    if max(info.binning_x, info.binning_y) > 1 or (info.roi.width and info.roi.width != info.width):
        raise UserError("binning or a region of interest", expected="the whole picture", **where)
    lens, model = np.zeros(0) if rectified else D, str(info.distortion_model)
    if np.any(lens) and (model not in MODELS or np.any(lens[5:])):
        expected = f"{' or '.join(MODELS)}, no coefficient but k1, k2, p1, p2, k3"
        raise UserError("a lens that is not read", expected=expected, got=f"{model}, {lens.tolist()}", **where)
    fx, fy, cx, cy = P[[0, 5, 2, 6]] if rectified else K[[0, 4, 2, 5]]
    if not (fx > 0 and fy > 0):
        expected = f"focal lengths above 0 in {'P' if rectified else 'K'} of its CameraInfo"
        raise UserError("a camera that is not calibrated", expected=expected, got=(float(fx), float(fy)), **where)
    k1, k2, p1, p2, k3 = np.pad(lens[:5], (0, 5 - len(lens[:5]))).tolist()
    return [float(fx), float(fy), float(cx), float(cy)], (k1, k2, p1, p2, k3)
