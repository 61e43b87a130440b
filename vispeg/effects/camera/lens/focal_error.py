"""Focal length error: the lens is longer or shorter than its calibration says, each axis by its own part.

Written to `cam_intrinsic`, whose first two numbers are the focal lengths: what is rendered changes, the K that the user
believes does not. Range: +-1 to 2 %; of 5 % the SVRC's guide
(docs/sources.md) says that it costs a grasp 10 to 15 % of its accuracy.
"""

from __future__ import annotations

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect


class FocalError(CameraEffect):
    """Error of the calibrated focal length."""

    name = "focal_error"
    channel = "border"
    writes = frozenset({"cam_intrinsic"})
    params = {
        "fx": Param(0.0, -0.2, 0.2, "1", start=0.02, doc="relative error of fx"),
        "fy": Param(0.0, -0.2, 0.2, "1", start=0.02, doc="relative error of fy"),
    }

    def write(self, fields, p):
        for row, camera, v in self.moved(fields, p):
            fields["cam_intrinsic"][row, camera, :2] *= (1 + v["fx"], 1 + v["fy"])
