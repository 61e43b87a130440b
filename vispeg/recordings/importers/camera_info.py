"""Read a camera from a ROS 1 or ROS 2 CameraInfo message."""

from __future__ import annotations

from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.frames.camera import RecordedCamera

MODELS = ("plumb_bob", "rational_polynomial")


def described(name: str, info: Any, rectified: bool, **where: Any) -> RecordedCamera:
    """Return the camera of the pictures that a CameraInfo message describes, without a pose.

    The message states the intrinsics of the whole sensor; the pictures may be a part of it (`roi`) in which blocks of
    `binning_x` times `binning_y` pixels became one.

    Args:
        name: of the camera.
        info: the message.
        rectified: whether the pictures were rectified: matrix P then applies, and no distortion.
        where: `file` or `key` of errors.

    Raises:
        UserError: not calibrated, a lens that Brown's model does not express, or a part of rectified pictures that is
            not the part of the sensor.
    """
    # fields are k, d and p in ROS 2, and K, D and P in ROS 1
    K, D, P = (np.ravel(getattr(info, name, getattr(info, name.upper(), ()))).astype(float) for name in "kdp")
    lens, model = np.zeros(0) if rectified else D, str(info.distortion_model)
    if np.any(lens) and (model not in MODELS or np.any(lens[5:])):
        expected = f"{' or '.join(MODELS)}, no coefficient but k1, k2, p1, p2, k3"
        raise UserError("a lens that is not read", expected=expected, got=f"{model}, {lens.tolist()}", **where)
    fx, fy, cx, cy = P[[0, 5, 2, 6]] if rectified else K[[0, 4, 2, 5]]
    if not (fx > 0 and fy > 0):
        expected = f"focal lengths above 0 in {'P' if rectified else 'K'} of its CameraInfo"
        raise UserError("a camera that is not calibrated", expected=expected, got=(float(fx), float(fy)), **where)
    part, blocks = info.roi, np.maximum([info.binning_x, info.binning_y], 1)  # 0 counts as 1
    whole = np.array([info.width, info.height])
    size = np.array([part.width or info.width, part.height or info.height])
    if rectified and part.do_rectify and (size < whole).any():
        raise UserError("rectified pictures of a region of interest of their own", expected="do_rectify off", **where)
    width, height = (size // blocks).tolist()
    fx, fy = (np.array([fx, fy]) / blocks).tolist()
    # the edge of the first pixel, half a pixel before its centre, stays where it is
    cx, cy = ((np.array([cx, cy]) - [part.x_offset, part.y_offset]) / blocks + (0.5 / blocks - 0.5)).tolist()
    k1, k2, p1, p2, k3 = np.pad(lens[:5], (0, 5 - len(lens[:5]))).tolist()
    return RecordedCamera(name, width, height, fx, fy, cx, cy, (k1, k2, p1, p2, k3))
