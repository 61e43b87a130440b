"""Replace operational space control (OSC) whose null space is too soft to hold a rollout near the recorded posture.

With a null-space stiffness of 10 1/s^2, a missing torque of 5 N m moves the posture by half a radian. The model then
has another inertia and gravity, its error is not linear in what is missing, and no candidate can be recognised. As with
a saturated drive (`opened`), the recording is therefore treated as torque-controlled: the commanded torques are
computed from the controller's readings, and an observer holds rollouts softly to the measured motion and posture.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.control.laws import hold_pose
from vispeg.core.rules import RULES
from vispeg.identify.evidence import Evidence
from vispeg.identify.nominal import nominal_robot
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import nominal_of
from vispeg.worlds.world import World

MOTION_HZ = 40.0  # bandwidth of velocities computed from angles, where none were recorded
ROWS = 4096  # samples whose dynamics are computed at a time, to limit memory
SOFT = "{}: the null space lets the model drift by {:.2g} rad, so the torques that the loop asked for drive the models"


def without_drift(evidence: Evidence, world: World) -> Evidence:
    """Return the evidence with the OSC recordings from which rollouts of `world` drift converted to torque control."""
    drift = _drift(evidence, world)
    if not drift:
        return evidence
    recordings = [as_torque_controlled(r, nominal_robot(r)) if id(r) in drift else r for r in evidence.recordings]
    out = Evidence(recordings, h_max=evidence.h_max, nthread=evidence.nthread)
    notes = [SOFT.format(r.name, drift[id(r)]) for r in evidence.recordings if id(r) in drift]
    out.notes, out.converted = [*evidence.notes, *notes], [*evidence.converted, *notes]
    return out


def _drift(evidence: Evidence, world: World) -> dict[int, float]:
    """Return how far rollouts of the world drift from each OSC recording, by its id, where it is over `RULES.posture`.

    The drift is the RMS angle error, rad, of the worst joint in the worst episode.
    """
    if all(i.recording.control.mode != "osc" for i in evidence.items):
        return {}
    out: dict[int, float] = {}
    for item, predicted in zip(evidence.items, evidence.simulated([world]), strict=True):
        if item.recording.control.mode == "osc":
            valid = item.valid[:, : item.nj]
            gap = np.where(valid, item.measured[:, : item.nj] - predicted[0][:, : item.nj], 0.0)
            gap = np.where(np.isfinite(gap), gap, np.pi)  # a rollout that diverged
            rms = np.sqrt((gap**2).sum(axis=0) / np.maximum(valid.sum(axis=0), 1)).max()
            out[id(item.recording)] = max(out.get(id(item.recording), 0.0), float(rms))
    return {key: rms for key, rms in out.items() if rms > RULES.posture}


def as_torque_controlled(rec: Recording, robot: RobotModel) -> Recording:
    """Return an OSC recording as one under torque control, with the torques that its law commands from the readings.

    They exclude gravity compensation, and are NaN at samples with a missing angle.
    """
    read = np.isfinite(rec.q).all(axis=1, keepdims=True)
    torque = np.where(read, _commanded(rec, robot), np.nan)
    return replace(rec, control=replace(rec.control, mode="torque"), tau_cmd=torque)


def _commanded(rec: Recording, robot: RobotModel) -> np.ndarray:
    """Return the torques (n, nj) N m that the OSC law (docs/formats.md) commands, without gravity compensation.

    A missing angle or speed counts as zero at its own sample.
    """
    c, n, q = rec.control, len(rec.q), np.nan_to_num(rec.q)
    assert rec.ee_cmd is not None and c.kp is not None and c.kd is not None
    dq = np.nan_to_num(smooth(rec.time, rec.q, MOTION_HZ, rec.episode)[1] if rec.dq is None else rec.dq)
    pull = None if c.nullspace is None else c.nullspace.kp * (c.nullspace.q - q) - c.nullspace.kd * dq
    parts = [q[start : start + ROWS] for start in range(0, n, ROWS)]
    operational = [nominal_of(robot, len(part)).operational(part) for part in parts]
    mass, jac, pos, quat, gravity = (np.concatenate(signal) for signal in zip(*operational, strict=True))
    state, kp, kd = (mass, jac, pos, quat, gravity), np.broadcast_to(c.kp, (n, 6)), np.broadcast_to(c.kd, (n, 6))
    tau = hold_pose(state, dq, rec.ee_cmd[:, :3], rec.ee_cmd[:, 3:], kp, kd, pull, c.force_limit)
    if c.torque_limit is None:
        return tau
    weight = gravity if c.gravity_compensation == "model" else 0.0
    return np.clip(tau + weight, -np.asarray(c.torque_limit), c.torque_limit) - weight
