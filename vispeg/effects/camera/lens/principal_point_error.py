"""Principal point error: the optical axis meets the image at another pixel than the calibrated one.

Written to the last two numbers of `cam_intrinsic`, the principal point's distance from the centre in m on the sensor,
with the sign of c = size / 2 - principal / pixel. The calibrated K does not change. Range: +-3 px.
"""

from __future__ import annotations

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect


class PrincipalPointError(CameraEffect):
    """Error of the calibrated principal point."""

    name = "principal_point_error"
    channel = "border"
    writes = frozenset({"cam_intrinsic"})
    told_from = {"camera_offset": "rolls of 90 degrees about the optical axis, with tilts"}
    params = {
        "x": Param(0.0, -30.0, 30.0, "px", start=2.0, doc="true minus calibrated point, to the right"),
        "y": Param(0.0, -30.0, 30.0, "px", start=2.0, doc="true minus calibrated point, downwards"),
    }

    def write(self, fields, p):
        for row, camera, v in self.moved(fields, p):
            pixel = fields.model.cam_sensorsize[camera] / fields.model.cam_resolution[camera]  # m
            fields["cam_intrinsic"][row, camera, 2:] -= pixel * (v["x"], v["y"])
