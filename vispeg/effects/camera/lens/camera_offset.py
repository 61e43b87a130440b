"""Camera pose error: the camera is displaced and rotated from the pose in its calibration.

A displacement and a rotation vector in the camera's own OpenCV axes (x right, y down, z forward), written to MuJoCo's
`cam_pos` and `cam_quat`, whose axes are (x, -y, -z). The calibration that policies and users have does not change.
Ranges: 2 to 10 mm and 1 to 3 deg for a careful hand-eye calibration; +-3 cm and +-5 deg to +-10 cm and +-10 deg in
the SVRC's guide (docs/sources.md).
"""

from __future__ import annotations

import mujoco
import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect

AXES = np.array([1.0, -1.0, -1.0])  # signs from OpenCV's to MuJoCo's camera axes


class CameraOffset(CameraEffect):
    """Error of the camera's extrinsic calibration."""

    name = "camera_offset"
    channel = "border"
    writes = frozenset({"cam_pos", "cam_quat"})
    params = {
        "x": Param(0.0, -0.1, 0.1, "m", start=0.005, doc="displacement to the right"),
        "y": Param(0.0, -0.1, 0.1, "m", start=0.005, doc="displacement downwards"),
        "z": Param(0.0, -0.1, 0.1, "m", start=0.005, doc="displacement forwards"),
        "rx": Param(0.0, -0.2, 0.2, "rad", start=0.02, doc="rotation about the axis to the right"),
        "ry": Param(0.0, -0.2, 0.2, "rad", start=0.02, doc="rotation about the axis downwards"),
        "rz": Param(0.0, -0.2, 0.2, "rad", start=0.02, doc="rotation about the optical axis"),
    }

    def write(self, fields, p):
        for row, camera, v in self.moved(fields, p):
            shift, turn = (np.array([v[k] for k in keys]) * AXES for keys in ("xyz", ("rx", "ry", "rz")))
            pos, quat = fields["cam_pos"][row, camera], fields["cam_quat"][row, camera]
            before, rotated_shift, after = np.array(quat, float), np.zeros(3), np.zeros(4)
            mujoco.mju_rotVecQuat(rotated_shift, shift, before)
            pos += rotated_shift
            angle = float(np.linalg.norm(turn))
            if angle:
                rotation = np.zeros(4)
                mujoco.mju_axisAngle2Quat(rotation, turn / angle, angle)
                mujoco.mju_mulQuat(after, before, rotation)
                quat[:] = after
