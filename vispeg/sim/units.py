"""The units of a recording against its robot: what cannot be true is refused, what can hardly be is said."""

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
    """Give the model's inverse dynamics, N m, of a motion (n, nj) rad, rad/s, rad/s^2; None for some of its joints
    alone.
    """
    if tuple(rec.joints) != robot.joints:
        return None

    model = copy(compiled(robot))
    model.opt.disableflags |= UNUSED
    data = mujoco.MjData(model)
    places = [model.joint(joint).qposadr[0] for joint in robot.joints]
    dofs = [model.joint(joint).dofadr[0] for joint in robot.joints]

    def needs(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        out = np.empty_like(q)
        for k in range(len(q)):
            data.qpos[places], data.qvel[dofs], data.qacc[dofs] = q[k], dq[k], ddq[k]
            mujoco.mj_inverse(model, data)
            out[k] = data.qfrc_inverse[dofs]
        return out

    return needs


def check_units(rec: Recording) -> None:
    """Give the rule of every command that compares or measures; a robot that cannot be read tells nothing.

    Raises:
        UserError: two signals exclude each other, or torques what the arm needs. Where only the robot's stated limits
            speak against a unit, that is a warning: files state limits that are none.
    """
    limits, needs = Limits(*(np.full((len(rec.joints), *n), np.inf) for n in ((2,), (), ()))), None
    limits.range[:, 0] = -np.inf
    try:
        robot = load_for(rec.joints, rec.robot, tool=rec.tool, base_tilt=rec.base_tilt)
    except UserError:  # is said where the robot is needed
        robot = None
    if robot is not None and set(rec.joints) <= set(robot.joints):
        limits, needs = Limits.of(robot, rec.joints), needs_of(robot, rec)
    for doubt in doubts(rec, limits, needs=needs):
        if doubt.sure:
            expected = f"rad, rad/s, s and N m, likely {doubt.likely}"
            raise UserError(f"a unit cannot be true: {doubt.said}", file=rec.path, key=doubt.key, expected=expected)
        note(f"{rec.path}: {doubt.line}")
