"""Estimate the wrench between flange and tool from joint torques, for arms without a wrist sensor.

The torque that the arm's links need for the measured motion is subtracted from the measured torque; the rest is due to
the wrench W on the tool: `J' W = tau - (M ddq + c + g)`. For a 7-joint arm these are seven equations for six unknowns,
solved by weighted least squares. Torque errors (friction after the sensor, hysteresis) enter W through the same matrix,
so that the accuracy of W depends on direction and posture. Source: De Luca and Mattone 2005, Sensorless robot collision
detection and hybrid force/motion control, ICRA; its observer is not needed offline, where accelerations are known.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from vispeg.recordings.differentiate import bridged, episodes, smooth
from vispeg.recordings.noise import highpass_sigma
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import BATCH, compiled, nominal_of
from vispeg.sim.inverse_dynamics import InverseDynamics

MOTION_HZ = 8.0  # bandwidth of the motion from which accelerations are computed
WRENCH_HZ = 20.0  # bandwidth of the wrench: above it, torque noise exceeds the contact's signal
STILL, AIR = 0.45, 1.0  # s at an episode's start during which the arm is at rest, and in free air
LINEAR = 0.01  # assumed nonlinearity of a torque sensor, as a share of the range of the joint's torque
BLOCK = 0.04  # s over which noise is averaged, to reveal errors that do not average out
# quantile of the squared block means that is used, and its value for chi squared with one degree of freedom
MOSTLY, QUANTILE = 0.9, 2.71
PRIOR = np.repeat([100.0, 10.0], 3)  # N, N m: 1-sigma prior of the wrench, for directions that torques do not show
BLIND = 0.2  # share of the prior: a direction with a larger posterior uncertainty counts as unobserved


@dataclass(frozen=True)
class External:
    """Wrenches of the flange on the tool, in flange axes about its origin, estimated from joint torques.

    Attributes:
        wrench: (n, 6) N, N m, below `WRENCH_HZ`; NaN in gaps of an angle or a torque that `smooth` does not bridge.
        gain: (n, 6, nj) derivative of the wrench with respect to joint torques.
        white: (nj,) N m, 1-sigma white noise of a sample.
        steady: (nj,) N m, 1-sigma slowly varying torque error: friction that the sensor sees, hysteresis.
        blind: (n, 6, 6) unobserved directions (columns), each scaled to the wrench's 1-sigma along it; 0 elsewhere.
    """

    wrench: np.ndarray
    gain: np.ndarray
    white: np.ndarray
    steady: np.ndarray
    blind: np.ndarray

    @property
    def noise(self) -> tuple[float, float]:
        """Return the 1-sigma of force (N) and torque (N m), averaged over directions and samples.

        It is the 1-sigma of white noise with the same variance of block means, since the low-pass lowers the variance
        of samples but correlates them.
        """
        variance = np.mean((self.gain * self.white) ** 2 @ np.ones(len(self.white)), axis=0)
        return float(np.sqrt(variance[:3].mean())), float(np.sqrt(variance[3:].mean()))

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviation (n, 6), N and N m, of the wrench averaged over a block.

        It combines the torque errors that do not average out with the uncertainty along unobserved directions.
        """
        steady = np.einsum("nij,j->ni", self.gain**2, self.steady**2)
        return np.sqrt(steady + np.sum(self.blind**2, axis=2))


def external(rec: Recording, arm: RobotModel) -> External:
    """Estimate the wrench on the tool of a recorded arm.

    Args:
        rec: recording with `tau`; the first second of each episode must be free of contact.
        arm: nominal arm with its declared tool, which is excluded from the torques that the links need.
    """
    assert rec.tau is not None
    q, dq, ddq = (
        np.nan_to_num(v) for v in smooth(rec.time, bridged(rec.time, rec.q, rec.episode), MOTION_HZ, rec.episode)
    )
    residual = rec.tau - needed(arm, q, dq, ddq)
    residual[np.isnan(rec.q).any(axis=1)] = np.nan  # the motion is only interpolated there
    jac = flange_jacobian(arm, q)
    white = _white(rec)
    steady = _steady(rec, np.nan_to_num(bridged(rec.time, residual, rec.episode)), jac, white)
    gain, blind = solved(jac, np.sqrt(white**2 + steady**2))
    wrench = np.einsum("nij,nj->ni", gain, smooth(rec.time, residual, WRENCH_HZ, rec.episode)[0])
    return External(wrench, gain, white, steady, blind)


def needed(arm: RobotModel, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Compute the torques (n, nj) N m of the links, without tool, for a motion (n, nj) in rad, rad/s, rad/s^2."""
    model = copy(compiled(arm))
    for body in range(model.nbody):
        ancestor = body
        while ancestor and model.body(ancestor).name != "tool":
            ancestor = int(model.body_parentid[ancestor])
        if ancestor:  # the tool, or a body that it carries
            model.body_mass[body], model.body_inertia[body] = 0.0, 0.0
    return InverseDynamics(model, arm.joints).torque(q, dq, ddq)


def flange_jacobian(arm: RobotModel, q: np.ndarray) -> np.ndarray:
    """Compute the Jacobian J (n, 6, nj), m/rad and rad/rad, in flange axes; a wrench W needs joint torques J' W."""
    from scipy.spatial.transform import Rotation

    out = np.empty((len(q), 6, q.shape[1]))
    for start in range(0, len(q), BATCH):
        block = slice(start, start + BATCH)
        _, jac, _, quat, _ = nominal_of(arm, len(q[block])).operational(q[block])
        turn = Rotation.from_quat(quat, scalar_first=True).inv().as_matrix()
        out[block, :3], out[block, 3:] = turn @ jac[:, :3], turn @ jac[:, 3:]
    return out


def solved(jac: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute `External.gain` and `External.blind` from Jacobians (n, 6, nj) and 1-sigma torque errors (nj,) N m.

    The wrench is the posterior mode under a normal prior of width `PRIOR`: the least-squares solution along observed
    directions, and 0 with the prior's width along unobserved ones.
    """
    scaled = jac * PRIOR[:, None] / sigma  # torques in sigmas per wrench in PRIOR
    inner = np.einsum("nij,nkj->nik", scaled, scaled) + np.eye(6)
    gain = PRIOR[:, None] * np.linalg.solve(inner, scaled / sigma)
    value, vector = np.linalg.eigh(inner)
    spread = 1 / np.sqrt(value)
    unseen = np.where(spread > BLIND, spread, 0.0)
    return gain, PRIOR[:, None] * vector * unseen[:, None, :]


def _white(rec: Recording) -> np.ndarray:
    """Return the 1-sigma noise (nj,) N m of a torque reading: as stated, else estimated at rest."""
    assert rec.tau is not None
    if "tau" in rec.noise:
        return np.full(rec.q.shape[1], float(rec.noise["tau"]))
    start = episodes(rec.time, rec.episode)[0]
    return np.maximum(highpass_sigma(rec.tau[start[rec.time[start] <= rec.time[start[0]] + STILL]]), 1e-6)


def _steady(rec: Recording, residual: np.ndarray, jac: np.ndarray, white: np.ndarray) -> np.ndarray:
    """Estimate the 1-sigma error (nj,) N m of joint torques that persists for longer than a block.

    It combines the sensor's nonlinearity and the torque residual of the first motion in free air (a high quantile, as
    friction appears only while a joint moves). Both are scaled up if the residual is larger in the null space of J,
    the combinations of torques that no wrench at the flange can cause.
    """
    assert rec.tau is not None
    linear = LINEAR * (np.nanquantile(rec.tau, 0.99, axis=0) - np.nanquantile(rec.tau, 0.01, axis=0))
    air_means, null_means, weights = [], [], []
    blind = np.linalg.svd(np.swapaxes(jac, 1, 2))[0][:, :, 6:]  # (n, nj, nj - 6), torques that no wrench causes
    size = max(1, round(BLOCK * rec.rate_hz))
    for rows in episodes(rec.time, rec.episode):
        clock = rec.time[rows] - rec.time[rows[0]]
        zero = residual[rows[clock <= STILL]].mean(axis=0)
        air = rows[(clock > STILL) & (clock <= AIR)]
        if len(air):  # short episodes have no such samples
            air_means.append(_blocks(residual[air] - zero, size))
        null_part = np.einsum("njk,nj->nk", blind[rows], residual[rows] - zero)
        null_means.append(_blocks(null_part, size))
        weights.append(_blocks((blind[rows] ** 2).sum(axis=2), size))
    noise = white**2 / size
    moved = np.concatenate(air_means) if air_means else np.zeros((1, residual.shape[1]))
    air_variance = np.maximum(np.quantile(moved**2, MOSTLY, axis=0) - QUANTILE * noise, 0.0)
    variance = linear**2 + air_variance
    measured = float(np.sum(np.concatenate(null_means) ** 2))
    weight = np.concatenate(weights).sum(axis=0)
    expected = float(weight @ variance)
    extra = measured - float(weight @ noise)
    return np.sqrt(variance * max(1.0, extra / expected if expected > 0 else 1.0))


def _blocks(values: np.ndarray, size: int) -> np.ndarray:
    """Average (n, k) over blocks of `size` rows, (m, k)."""
    m = max(1, len(values) // size)
    return values[: m * size].reshape(m, min(size, len(values)), values.shape[1]).mean(axis=1)
