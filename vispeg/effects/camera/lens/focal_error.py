"""Focal length error: the true focal lengths differ from the calibrated ones, for each axis of the image.

Written to the first two numbers of `cam_intrinsic`, the focal lengths. The rendered image changes; the calibrated K
does not. Range: +-1 to 2 %. By the SVRC's guide (docs/sources.md), 5 % cost a grasp 10 to 15 % of its accuracy.
"""

from __future__ import annotations

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect


class FocalError(CameraEffect):
    """Error of the calibrated focal length."""

    name = "focal_error"
    channel = "border"
    writes = frozenset({"cam_intrinsic"})
    told_from = {
        "camera_offset": "tilts of 20 degrees or more and an approach from 0.4 to 0.15 m",
        "lens_distortion": "views with the fixture near the image's edges and corners",
    }
    params = {
        "fx": Param(0.0, -0.2, 0.2, "1", start=0.02, doc="relative error of fx"),
        "fy": Param(0.0, -0.2, 0.2, "1", start=0.02, doc="relative error of fy"),
    }

    def write(self, fields, p):
        for row, camera, v in self.moved(fields, p):
            fields["cam_intrinsic"][row, camera, :2] *= (1 + v["fx"], 1 + v["fy"])
