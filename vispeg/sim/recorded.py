"""Match a recording with the nominal model of its robot."""

from __future__ import annotations

from vispeg.core.errors import UserError
from vispeg.recordings.recording import Recording, in_order
from vispeg.robots.model import RobotModel, load_for


def with_robot(rec: Recording) -> tuple[Recording, RobotModel]:
    """Return a recording with its joints in the robot's order, and the robot with the declared tool and base tilt.

    Joints of the robot that the recording does not list are held at their initial position.

    Raises:
        UserError: an unknown robot, or joints that it does not have.
    """
    robot = load_for(rec.joints, rec.robot, tool=rec.tool, base_tilt=rec.base_tilt)
    rec = in_order(rec, robot.joints)
    if rec.joints != robot.joints:
        expected, got = ", ".join(robot.joints), ", ".join(rec.joints)
        file = rec.path / "recording.yaml"
        raise UserError(
            "the recording's joints are not the robot's", file=file, key="joints", expected=expected, got=got
        )
    return rec, robot
