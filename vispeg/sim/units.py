"""Check a recording's units against its robot: impossible ones are refused, implausible ones cause a warning."""

from __future__ import annotations

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.importers.fits import Needs
from vispeg.recordings.importers.plausible import doubts
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel, load_for
from vispeg.sim.compiled import compiled
from vispeg.sim.inverse_dynamics import InverseDynamics


def needs_of(robot: RobotModel, rec: Recording) -> Needs | None:
    """Return a function for the model's inverse dynamics; None if the recording has other joints than the robot.

    It takes q, dq and ddq (n, nj) in rad, rad/s and rad/s^2 and returns torques (n, nj) N m, in the recording's order.
    """
    if set(rec.joints) != set(robot.joints):
        return None

    order = [robot.joints.index(joint) for joint in rec.joints]
    dynamics = InverseDynamics(compiled(robot), robot.joints)

    def needs(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        motion = np.empty((3, *q.shape))
        motion[..., order] = q, dq, ddq
        return dynamics.torque(motion[0], motion[1], motion[2])[:, order]

    return needs


def check_units(rec: Recording) -> None:
    """Check the units before a comparison or measurement; without a readable robot nothing is checked.

    Raises:
        UserError: two signals contradict each other, or torques contradict the model's. If a unit contradicts only the
            robot's stated limits, that is a warning, as limits in robot files may be placeholders.
    """
    nj, needs = len(rec.joints), None
    limits = Limits(np.tile([-np.inf, np.inf], (nj, 1)), np.full(nj, np.inf), np.full(nj, np.inf))
    try:
        robot = load_for(rec.joints, rec.robot, tool=rec.tool, base_tilt=rec.base_tilt)
    except UserError:  # the error is raised again where the robot is needed
        robot = None
    if robot is not None and set(rec.joints) <= set(robot.joints):
        limits, needs = Limits.of(robot, rec.joints), needs_of(robot, rec)
    for doubt in doubts(rec, limits, needs=needs):
        if doubt.sure:
            expected = f"rad, rad/s, s and N m, likely {doubt.likely}"
            raise UserError(f"a unit cannot be true: {doubt.said}", file=rec.path, key=doubt.key, expected=expected)
        note(f"{rec.path}: {doubt.line}")
