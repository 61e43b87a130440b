"""Position loops that a saturated drive leaves open.

A saturated drive no longer follows its command, so the loop is open: even a rollout of the correct model diverges from
the recording, and the error says nothing about the model. If a drive is saturated for most of a recording, the
recording is therefore treated as torque-controlled: the commanded torques are computed from the controller's readings,
and an observer holds rollouts softly to the measured motion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.control.laws import position
from vispeg.core.rules import RULES
from vispeg.recordings.differentiate import CUTOFF_HZ, differences, smooth
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel
from vispeg.sim.segments.along import gravity, inertia
from vispeg.sim.segments.segment import Segment, segments

OPEN = "{}: a drive is saturated most of the time, so the torques that its loop asked for drive the models"  # a note


def torque_if_saturated(rec: Recording, robot: RobotModel) -> Recording:
    """Return the recording; if a drive is saturated most of the time, as one under torque control."""
    if rec.control.mode != "position" or rec.q_cmd is None or not saturated(rec, robot).any():
        return rec
    return replace(rec, control=replace(rec.control, mode="torque"), tau_cmd=_asked(rec))


def saturated(rec: Recording, robot: RobotModel) -> np.ndarray:
    """Return the joints whose drive is saturated most of the time, (nj,) bool.

    In such a joint the loop mostly asks for far more than the motion needs, and then the drive gives its limit in the
    direction asked: the torque that the motion needs in that direction is on average larger than its scatter.
    """
    parts = [_torques(rec, robot, s) for s in segments(rec)]
    if not parts:
        return np.zeros(len(rec.joints), bool)
    asked, needed = (np.concatenate(side) for side in zip(*parts, strict=True))
    beyond = np.abs(asked) > RULES.saturated_beyond * np.abs(needed).max(axis=0)
    count = np.maximum(beyond.sum(axis=0), 1)
    along = np.where(beyond, np.sign(asked) * needed, 0.0)
    mean = along.sum(axis=0) / count
    spread = np.sqrt(np.where(beyond, (along - mean) ** 2, 0.0).sum(axis=0) / count)
    most = 2 * beyond.sum(axis=0) > len(beyond)
    return most & (spread < mean)


def _torques(rec: Recording, robot: RobotModel, s: Segment) -> tuple[np.ndarray, np.ndarray]:
    """Return the torques (n, nj) N m that the loop commanded, and that the nominal arm needs, at control ticks."""
    grid = np.arange(s.ticks) * s.tick
    weight = gravity(s, robot)
    _, _, ddq = smooth(grid, s.q_raw, CUTOFF_HZ)
    needed = np.einsum("nij,nj->ni", inertia(s, robot), ddq) + weight
    asked, time = _asked(rec)[s.rows], rec.time[s.rows] - rec.time[s.rows[0]]
    asked = np.stack([np.interp(grid, time, joint) for joint in asked.T], axis=1)
    return asked + (weight if rec.control.gravity_compensation == "model" else 0.0), needed


def _asked(rec: Recording) -> np.ndarray:
    """Return the torques that the loop commanded from its readings, without gravity compensation, (n, nj) N m."""
    assert rec.q_cmd is not None and rec.control.kp is not None and rec.control.kd is not None
    goal = np.zeros_like(rec.q) if rec.dq_cmd is None else rec.dq_cmd
    speed = differences(rec.time, rec.q, rec.episode) if rec.dq is None else rec.dq
    return position(rec.q_cmd, goal, rec.q, speed, rec.control.kp, rec.control.kd)
