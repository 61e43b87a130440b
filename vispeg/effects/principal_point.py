"""Principal point error: the optical axis meets the image elsewhere than its calibration says.

Written to `cam_intrinsic`, whose last two numbers are the principal point's distance from the centre in m on the
sensor, with the sign that makes the pixel c = size / 2 - principal / pixel. What the user believes of K stays. Range:
+-3 px.
"""

from __future__ import annotations

from vispeg.core.params import Param
from vispeg.effects._camera import CameraEffect


class PrincipalPoint(CameraEffect):
    """An image a little beside where K says."""

    name = "principal_point"
    writes = frozenset({"cam_intrinsic"})
    params = {
        "x": Param(0.0, -30.0, 30.0, "px", start=2.0, doc="to the right"),
        "y": Param(0.0, -30.0, 30.0, "px", start=2.0, doc="downwards"),
    }

    def write(self, fields, p):
        for column, name in enumerate(fields.scene.cameras):
            i = fields.model.camera(name).id
            pixel = fields.model.cam_sensorsize[i] / fields.model.cam_resolution[i]  # m
            for row in self.rows({k: v[:, column] for k, v in p.items()}):
                shift = (p["x"][row, column], p["y"][row, column])
                fields["cam_intrinsic"][row, i, 2:] -= pixel * shift
