"""Examine the contact in recordings, for `vispeg check`."""

from __future__ import annotations

import numpy as np

from vispeg.contact.again.blows import blows, restarts
from vispeg.contact.beginning import refuse_foreign
from vispeg.contact.inputs import touching
from vispeg.contact.torques import sensed
from vispeg.control.laws import rotated
from vispeg.core.errors import UserError
from vispeg.recordings.checks.contact_check import ContactCheck, Touched, examine
from vispeg.recordings.recording import Recording, in_order
from vispeg.robots.model import RobotModel
from vispeg.robots.scene import Scene
from vispeg.sim.recorded import with_robot
from vispeg.sim.touch import Touch, touch
from vispeg.task.belief import recorded_cell


def check_contact(rec: Recording) -> tuple[ContactCheck, Touch] | None:
    """Return findings on the contact in a recording with a wrench, and the contact over time.

    None without a wrench, or if nothing states how to read it.

    Raises:
        UserError: a cell, robot or tool that cannot be built, or in a task's cell a wrench that no comparison accepts.
    """
    if rec.ft is None or (rec.wrench is None and rec.cell is None):
        return None
    header = rec.path / "recording.yaml"
    robot: RobotModel
    try:
        if rec.cell is None or rec.cell.bench:
            rec, robot = with_robot(rec)
        else:
            robot = recorded_cell(rec).scene
            rec = in_order(rec, robot.joints)
    except UserError as error:
        raise error if error.file else UserError(str(error), file=header) from error
    contact = touch(rec, robot)
    if contact is None:
        return None
    if isinstance(robot, Scene) and sensed(rec):
        refuse_foreign(touching(rec), contact)
    quat = contact.flange[:, 3:]
    # the flange's z and x axes in the base, (n, 3) each
    axis, side = (rotated(quat, np.tile(e, (len(quat), 1))) for e in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    episode = np.zeros(len(rec.time), int) if rec.episode is None else rec.episode
    tilt = np.arccos(np.clip(axis @ axis[0], -1.0, 1.0))
    yaw = np.unwrap(np.arctan2(side[:, 1], side[:, 0]))
    goal = isinstance(robot, Scene) and bool(robot.goal)
    speeds = tuple(b.speed for b in blows(rec, contact)) if goal and restarts(rec) else None
    touched = Touched(rec.time, episode, contact.regime, contact.force, contact.velocity, tilt, yaw, goal, speeds)
    return examine(touched), contact
