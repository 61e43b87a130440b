"""The wrench between flange and tool from the torques in an arm's joints, where no sensor sits at the wrist.

What the arm's own links need for the measured motion is taken off what the joints' sensors read; the rest holds the
tool: `J' W = tau - (M ddq + c + g)`, seven equations for six numbers, solved by weighted least squares. What joints and
their sensors are off by (friction behind the sensor, hysteresis) is in W through the same matrix, so that how well W is
known depends on direction and posture. Source: De Luca and Mattone 2005, Sensorless robot collision detection and
hybrid force/motion control, ICRA; its observer is not needed where accelerations are known afterwards.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import batch as mjb

from vispeg.recordings.differentiate import episodes, smooth
from vispeg.recordings.noise import highpass_sigma
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import ARMS, compiled, nominal_of
from vispeg.sim.nominal import dense

MOTION_HZ = 8.0  # bandwidth of the motion whose acceleration is believed
WRENCH_HZ = 20.0  # ... and of the wrench: faster, a torque sensor's noise exceeds what a contact does
STILL, AIR = 0.45, 1.0  # s at an episode's start: at rest, and in free air
LINEAR = 0.01  # of what a joint's torque varies by: how far a torque sensor is trusted to be linear
BLOCK = 0.04  # s over which noise is averaged to see what does not average out
MOSTLY, QUANTILE = 0.9, 2.71  # share of blocks that are off by no more, and what of chi squared noise alone reaches
PRIOR = np.repeat([100.0, 10.0], 3)  # N, N m: no wrench is greater; what bounds a direction that torques do not see
BLIND = 0.2  # of that: beyond it a direction is not seen


@dataclass(frozen=True)
class External:
    """Wrenches that flange puts on tool, flange axes and origin, as joint torques tell them.

    Attributes:
        wrench: (n, 6) N, N m, below `WRENCH_HZ`.
        gain: (n, 6, nj): of the wrench by each joint's torque.
        white: (nj,) N m, noise of a sample.
        steady: (nj,) N m, how far a joint's torque is off for longer: friction that the sensor sees, hysteresis.
        blind: (n, 6, 6) directions (columns) that are not seen, each as long as the wrench along it is unsure; 0 else.
    """

    wrench: np.ndarray
    gain: np.ndarray
    white: np.ndarray
    steady: np.ndarray
    blind: np.ndarray

    @property
    def noise(self) -> tuple[float, float]:
        """1-sigma of a force (N) and a torque (N m), in the mean over directions and samples.

        It is that of white noise that leaves as much over a block: what the low-pass takes off, it makes last longer.
        """
        variance = np.mean((self.gain * self.white) ** 2 @ np.ones(len(self.white)), axis=0)
        return float(np.sqrt(variance[:3].mean())), float(np.sqrt(variance[3:].mean()))

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviation of the wrench averaged over a block, (n, 6) N, N m: noise that remains, and unobservable
        parts.
        """
        steady = np.einsum("nij,j->ni", self.gain**2, self.steady**2)
        return np.sqrt(steady + np.sum(self.blind**2, axis=2))


def external(rec: Recording, arm: RobotModel) -> External:
    """Give the wrench on the tool of a recorded arm.

    Args:
        rec: with `tau`; nothing is touched in the first second of an episode.
        arm: nominal, with its declared tool, which is left out of what the arm itself needs.
    """
    assert rec.tau is not None
    q, dq, ddq = (np.nan_to_num(v) for v in smooth(rec.time, rec.q, MOTION_HZ))
    residual = np.nan_to_num(rec.tau) - needed(arm, q, dq, ddq)
    jac = flange_jacobian(arm, q)
    white = _white(rec)
    steady = _steady(rec, residual, jac, white)
    gain, blind = solved(jac, np.sqrt(white**2 + steady**2))
    wrench = np.einsum("nij,nj->ni", gain, np.nan_to_num(smooth(rec.time, residual, WRENCH_HZ)[0]))
    return External(wrench, gain, white, steady, blind)


def needed(arm: RobotModel, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Torques (n, nj) N m that the arm's own links need for a motion (n, nj) in rad, rad/s, rad/s^2; tool left out."""
    model = copy(compiled(arm))
    for body in range(model.nbody):
        above = body
        while above and model.body(above).name != "tool":
            above = int(model.body_parentid[above])
        if above:
            model.body_mass[body], model.body_inertia[body] = 0.0, 0.0
    dofs = np.array([model.joint(j).dofadr[0] for j in arm.joints])
    places = np.array([model.joint(j).qposadr[0] for j in arm.joints])
    out = np.empty_like(q)
    for start in range(0, len(q), ARMS):
        some = slice(start, start + ARMS)
        batch = mjb.Batch(model, len(q[some]), nthread=1)
        batch.bind("qpos")[:, places], batch.bind("qvel")[:, dofs] = q[some], dq[some]
        bias, mass = batch.bind("qfrc_bias"), batch.bind("M")
        batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
        full = dense(model, mass)[:, dofs][:, :, dofs]
        out[some] = np.einsum("nij,nj->ni", full, ddq[some]) + bias[:, dofs]
    return out + model.dof_damping[dofs] * dq


def flange_jacobian(arm: RobotModel, q: np.ndarray) -> np.ndarray:
    """(n, 6, nj) m/rad and rad/rad in the flange's own axes: joint torques of a wrench W there are J' W."""
    from scipy.spatial.transform import Rotation

    out = np.empty((len(q), 6, q.shape[1]))
    for start in range(0, len(q), ARMS):
        some = slice(start, start + ARMS)
        _, jac, _, quat, _ = nominal_of(arm, len(q[some])).operational(q[some])
        turn = Rotation.from_quat(quat, scalar_first=True).inv().as_matrix()
        out[some, :3], out[some, 3:] = turn @ jac[:, :3], turn @ jac[:, 3:]
    return out


def solved(jac: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`External.gain` and `External.blind` of Jacobians (n, 6, nj) and joint torques good to `sigma` (nj,) N m.

    The most likely wrench under a broad normal law of `PRIOR`: along what is seen the least-squares answer, along what
    is not nothing, as unsure as that law.
    """
    scaled = jac * PRIOR[:, None] / sigma  # unit torques by wrenches of PRIOR
    inner = np.einsum("nij,nkj->nik", scaled, scaled) + np.eye(6)
    gain = PRIOR[:, None] * np.linalg.solve(inner, scaled / sigma)
    value, vector = np.linalg.eigh(inner)
    spread = 1 / np.sqrt(value)
    unseen = np.where(spread > BLIND, spread, 0.0)
    return gain, PRIOR[:, None] * vector * unseen[:, None, :]


def _white(rec: Recording) -> np.ndarray:
    """Noise (nj,) N m of a torque reading, as stated or as heard at rest."""
    assert rec.tau is not None
    if "tau" in rec.noise:
        return np.full(rec.q.shape[1], float(rec.noise["tau"]))
    start = episodes(rec.time)[0]
    return np.maximum(highpass_sigma(rec.tau[start[rec.time[start] <= rec.time[start[0]] + STILL]]), 1e-6)


def _steady(rec: Recording, residual: np.ndarray, jac: np.ndarray, white: np.ndarray) -> np.ndarray:
    """How far joint torques are off for longer than a block (nj,) N m.

    That a torque sensor is not linear; what the first moves in free air leave (mostly, as friction shows while a joint
    moves); both scaled up where the one combination of torques that no wrench at the flange makes is off by more.
    """
    assert rec.tau is not None
    linear = LINEAR * (np.nanquantile(rec.tau, 0.99, axis=0) - np.nanquantile(rec.tau, 0.01, axis=0))
    off, across, weights = [], [], []
    blind = np.linalg.svd(np.swapaxes(jac, 1, 2))[0][:, :, 6:]  # (n, nj, nj - 6) of which no wrench makes a torque
    size = max(1, round(BLOCK * rec.rate_hz))
    for rows in episodes(rec.time):
        clock = rec.time[rows] - rec.time[rows[0]]
        zero = residual[rows[clock <= STILL]].mean(axis=0)
        air = rows[(clock > STILL) & (clock <= AIR)]
        if len(air):  # an episode may end before
            off.append(_blocks(residual[air] - zero, size))
        beside = np.einsum("njk,nj->nk", blind[rows], residual[rows] - zero)
        across.append(_blocks(beside, size))
        weights.append(_blocks((blind[rows] ** 2).sum(axis=2), size))
    noise = white**2 / size
    moved = np.concatenate(off) if off else np.zeros((1, residual.shape[1]))
    free = np.maximum(np.quantile(moved**2, MOSTLY, axis=0) - QUANTILE * noise, 0.0)
    square = linear**2 + free
    measured = float(np.sum(np.concatenate(across) ** 2))
    weight = np.concatenate(weights).sum(axis=0)
    expected = float(weight @ square)
    extra = measured - float(weight @ noise)
    return np.sqrt(square * max(1.0, extra / expected if expected > 0 else 1.0))


def _blocks(values: np.ndarray, size: int) -> np.ndarray:
    """Means (m, k) over blocks of `size` of (n, k)."""
    m = max(1, len(values) // size)
    return values[: m * size].reshape(m, min(size, len(values)), values.shape[1]).mean(axis=1)
