"""The nominal robot of a recording: the arm of its model file with the recording's declared tool and base tilt.

Joint stops that the recorded motion passed are left out, since the robot cannot have them there.
"""

from __future__ import annotations

from vispeg.core.errors import UserError
from vispeg.identify.loops.stops import passed, without_stops
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel, load, load_for

# by the whole robot, hashed by identity, and the recording's joints; a note on joints held at rest is then shown once
_ROBOTS: dict[tuple[RobotModel, tuple[str, ...]], RobotModel] = {}


def robot_of(rec: Recording) -> RobotModel:
    """Return the nominal robot of a recording, without stops that a joint was measured beyond."""
    robot = nominal_robot(rec)
    return without_stops(robot, passed(robot, rec.q))


def nominal_robot(rec: Recording) -> RobotModel:
    """Return the nominal robot of a recording, with its declared tool and base tilt.

    Joints of the robot's file that the recording does not list are held at rest.

    Raises:
        UserError: a robot, tool or joints that do not fit together.
    """
    try:
        key = load(rec.robot, rec.tool, rec.base_tilt), rec.joints  # an edited file is another robot
        if key not in _ROBOTS:
            _ROBOTS[key] = load_for(rec.joints, rec.robot, rec.tool, rec.base_tilt)
    except UserError as error:
        raise UserError(str(error), file=rec.path / "recording.yaml") from error
    robot = _ROBOTS[key]
    if tuple(rec.joints) != tuple(robot.joints):
        raise UserError(
            "the recording's joints are not the robot's",
            file=rec.path / "recording.yaml",
            key="joints",
            expected=", ".join(robot.joints),
            got=", ".join(rec.joints),
        )
    return robot
