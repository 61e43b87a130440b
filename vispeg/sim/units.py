"""Check a recording's units against its robot: impossible ones are refused, implausible ones cause a warning."""

from __future__ import annotations

from copy import copy

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.importers.plausible import Needs, doubts
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel, load_for
from vispeg.sim.compiled import compiled
from vispeg.sim.nominal import UNUSED


def needs_of(robot: RobotModel, rec: Recording) -> Needs | None:
    """Return a function for the model's inverse dynamics; None if the recording has other joints than the robot.

    It takes q, dq and ddq (n, nj) in rad, rad/s and rad/s^2 and returns torques (n, nj) N m, in the recording's order.
    """
    if set(rec.joints) != set(robot.joints):
        return None

    model = copy(compiled(robot))
    model.opt.disableflags |= UNUSED
    data = mujoco.MjData(model)
    places = [model.joint(joint).qposadr[0] for joint in rec.joints]
    dofs = [model.joint(joint).dofadr[0] for joint in rec.joints]

    def needs(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        out = np.empty_like(q)
        for k in range(len(q)):
            data.qpos[places], data.qvel[dofs], data.qacc[dofs] = q[k], dq[k], ddq[k]
            mujoco.mj_inverse(model, data)
            out[k] = data.qfrc_inverse[dofs]
        return out

    return needs


def check_units(rec: Recording) -> None:
    """Check the units before a comparison or measurement; without a readable robot nothing is checked.

    Raises:
        UserError: two signals contradict each other, or torques contradict the model's. If a unit contradicts only the
            robot's stated limits, that is a warning, as limits in robot files may be placeholders.
    """
    limits, needs = Limits(*(np.full((len(rec.joints), *n), np.inf) for n in ((2,), (), ()))), None
    limits.range[:, 0] = -np.inf
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
