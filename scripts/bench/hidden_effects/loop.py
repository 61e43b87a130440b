"""Closed loop on the hidden plant: sensors, the three controllers of docs/formats.md at 500 Hz with zero-order hold."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from arm import rigid
from hidden import Hide, joint_parameters
from mujoco.batch import Batch
from plant import VEL, Plant

from vispeg.core.seeds import stream
from vispeg.identify.excitation import SEVEN_AXIS_CENTRE, Motion

RATE = 500.0  # Hz
PREROLL = 0.6  # s of standing still before the recording starts
NOISE = {"q": 2.0e-5, "dq": 1.0e-3, "tau": 0.2}
GAINS = {  # kp, kd; torque: of the feedback that is part of tau_cmd
    "position": ([400.0, 600.0, 150.0, 300.0, 30.0, 40.0, 4.0], [20.0, 50.0, 5.0, 15.0, 0.6, 0.7, 0.06]),
    "soft": ([50.0, 75.0, 19.0, 38.0, 3.8, 5.0, 0.5], [7.0, 18.0, 1.8, 5.3, 0.21, 0.25, 0.021]),  # a position law, too
    "torque": ([150.0, 150.0, 60.0, 100.0, 15.0, 15.0, 2.0], [12.0, 25.0, 3.5, 9.0, 0.45, 0.45, 0.04]),
    "osc": ([150.0, 150.0, 150.0, 150.0, 150.0, 150.0], [24.0, 24.0, 24.0, 24.0, 24.0, 24.0]),
}
NULLSPACE = (10.0, 6.0, np.array(SEVEN_AXIS_CENTRE))  # kp 1/s^2, kd 1/s, q rad


@dataclass(frozen=True)
class Run:
    """One recording to make: what is hidden, the commanded motion, the controller, the noise seed."""

    hidden: tuple[Hide, ...]
    motion: Motion
    mode: str
    seed: int


class Nominal:
    """The nominal arm's M, g and flange kinematics, rows at a time, as the controller computes them."""

    def __init__(self, nrow: int):
        model = rigid()
        self.n, self.batch, self.dense = nrow, Batch(model, nrow, nthread=1), model.mapM2D
        names = ("M", "qfrc_bias", "xaxis", "xanchor", "site_xpos", "site_xmat")
        self.out = {name: self.batch.bind(name) for name in names}
        self.qpos, self.qvel = self.batch.bind("qpos"), self.batch.bind("qvel")

    def at(self, q: np.ndarray, dq: np.ndarray | float = 0.0) -> Nominal:
        """Evaluate at q, dq (nrow, 7)."""
        self.qpos[:], self.qvel[:] = q, dq
        self.batch.forward(stage=VEL)
        return self

    @property
    def bias(self) -> np.ndarray:
        """Gravity and velocity torques (nrow, 7), N m."""
        return self.out["qfrc_bias"].copy()

    @property
    def mass(self) -> np.ndarray:
        """Inertia M (nrow, 7, 7)."""
        return self.out["M"][:, self.dense].reshape(self.n, 7, 7)

    def jacobian(self) -> np.ndarray:
        """Return the flange Jacobian (nrow, 6, 7) in the base frame, translation first."""
        axis = self.out["xaxis"]
        linear = np.cross(axis, self.out["site_xpos"] - self.out["xanchor"])
        return np.concatenate([linear, axis], axis=2).transpose(0, 2, 1)


def simulate(runs: list[Run], h: float = 2.0e-4, noise: bool = True) -> list[dict[str, np.ndarray]]:
    """Return the signals (n, 7) of every run: q, dq, tau, and by its mode tau_cmd, q_cmd and dq_cmd, or ee_cmd.

    All runs must last equally long; each draws its noise from its own seed, so a row does not depend on the others.
    `tau` is the gear torque just before the row's command takes over.
    """
    n, hold, sub = len(runs[0].motion.time), round(PREROLL * RATE), round(1.0 / RATE / h)
    q_cmd = np.stack([r.motion.q_cmd for r in runs])  # (nrow, n, 7)
    dq_cmd = np.stack([r.motion.dq_cmd for r in runs])
    hidden = [r.hidden for r in runs]
    start = q_cmd[:, 0] - joint_parameters(hidden)["offset"]  # where the encoders read the first command
    plant, nominal = Plant(hidden, start, h), Nominal(len(runs))
    law = _Law(runs, nominal, q_cmd, dq_cmd)
    sense = _Sensors(plant, [r.seed for r in runs], n + hold, noise)
    drives = _Delayed(plant)
    out = {key: np.zeros((len(runs), n, 7)) for key in ("q", "dq", "tau", "tau_cmd")}
    plant.settle_load(nominal.at(q_cmd[:, 0]).bias)
    plant.t = -hold / RATE
    for k in range(-hold, n):
        q, dq, tau = sense.read()
        tau_cmd, u = law(max(k, 0), k < 0, q, dq)
        drives.send(u)
        if k >= 0:
            out["q"][:, k], out["dq"][:, k], out["tau"][:, k], out["tau_cmd"][:, k] = q, dq, tau, tau_cmd
        for i in range(sub):
            plant.tick(drives.at(i))
            sense.push()
    if not all(np.isfinite(v).all() and np.abs(out["q"]).max() < 20.0 for v in out.values()):
        bad = [r for r in range(len(runs)) if not np.abs(out["q"][r]).max() < 20.0]
        raise RuntimeError(f"hidden plant diverged in rows {bad}: {[runs[b].hidden for b in bad]}")
    return [_signals(run, {key: v[r] for key, v in out.items()}) for r, run in enumerate(runs)]


def _signals(run: Run, out: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    if run.mode in ("position", "soft"):
        del out["tau_cmd"]
        return out | {"q_cmd": run.motion.q_cmd, "dq_cmd": run.motion.dq_cmd}
    if run.mode == "osc":
        del out["tau_cmd"]
        return out | {"ee_cmd": run.motion.ee_cmd}
    return out


class _Law:
    """Control torque of every row: its own part `tau_cmd` and the total `u` with nominal gravity."""

    def __init__(self, runs: list[Run], nominal: Nominal, q_cmd: np.ndarray, dq_cmd: np.ndarray):
        self.nominal, self.q_cmd, self.dq_cmd = nominal, q_cmd, dq_cmd
        self.osc = np.array([r.mode == "osc" for r in runs])
        joint = [GAINS["position" if r.mode == "osc" else r.mode] for r in runs]
        self.kp, self.kd = np.array([g[0] for g in joint]), np.array([g[1] for g in joint])
        self.forward = np.zeros_like(q_cmd)  # feed-forward of `torque`: nominal inverse dynamics less gravity
        torque = np.array([r.mode == "torque" for r in runs])
        if torque.any():
            acc = np.gradient(dq_cmd, 1.0 / RATE, axis=1)
            for k in range(q_cmd.shape[1]):
                at = nominal.at(q_cmd[:, k], dq_cmd[:, k])
                full = np.einsum("rij,rj->ri", at.mass, acc[:, k]) + at.bias
                self.forward[:, k] = np.where(torque[:, None], full - nominal.at(q_cmd[:, k]).bias, 0.0)
        if self.osc.any():
            still = np.zeros((q_cmd.shape[1], 7))
            self.goal = np.stack([still if r.motion.ee_cmd is None else r.motion.ee_cmd for r in runs])

    def __call__(self, k: int, hold: bool, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        now = self.nominal.at(q)
        gravity = now.bias
        want = 0.0 if hold else self.dq_cmd[:, k]
        tau = self.kp * (self.q_cmd[:, k] - q) + self.kd * (want - dq)
        tau = tau if hold else tau + self.forward[:, k]
        if self.osc.any():
            tau = np.where(self.osc[:, None], self._khatib(now, k, q, dq), tau)
        return tau, tau + gravity

    def _khatib(self, now: Nominal, k: int, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        """Return the torque (nrow, 7) of Khatib's law as docs/formats.md states it, without the gravity term."""
        jac, mass = now.jacobian(), now.mass
        kp, kd = (np.array(g) for g in GAINS["osc"])
        place, turn = now.out["site_xpos"][:, 0], now.out["site_xmat"][:, 0].reshape(-1, 3, 3)
        error = np.zeros((now.n, 6))
        error[:, :3] = self.goal[:, k, :3] - place
        for r in np.flatnonzero(self.osc):
            error[r, 3:] = _rotation_vector(self.goal[r, k, 3:], turn[r])
        minv_jt = np.linalg.solve(mass, jac.transpose(0, 2, 1))
        lam = np.linalg.inv(jac @ minv_jt)
        speed = np.einsum("rij,rj->ri", jac, dq)
        force = np.einsum("rij,rj->ri", lam, kp * error - kd * speed)
        kpn, kdn, qn = NULLSPACE
        posture = np.einsum("rij,rj->ri", mass, kpn * (qn - q) - kdn * dq)
        jbar = minv_jt @ lam
        seen = np.einsum("rji,rj->ri", jbar, posture)
        return np.einsum("rji,rj->ri", jac, force - seen) + posture


def _rotation_vector(goal: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return the rotation vector (3,) rad, base frame, from `turn` (3, 3) to the quaternion `goal` (w, x, y, z)."""
    want = np.zeros(9)
    mujoco.mju_quat2Mat(want, goal)
    delta, quat, out = want.reshape(3, 3) @ turn.T, np.zeros(4), np.zeros(3)
    mujoco.mju_mat2Quat(quat, delta.ravel())
    mujoco.mju_quat2Vel(out, quat, 1.0)
    return out


class _Sensors:
    """Encoders on the motor side and torque sensors behind the gear, with delay, offset, noise and quantization."""

    def __init__(self, plant: Plant, seeds: list[int], reads: int, noise: bool):
        self.plant, p = plant, plant.p
        size = (reads, 7)
        draws = [stream(seed, "sensor noise") for seed in seeds]
        self.noise = {k: np.stack([s * noise * g.standard_normal(size) for g in draws]) for k, s in NOISE.items()}
        self.k = 0
        late = p["sense_delay"] / plant.h
        self.late = np.floor(late).astype(int)
        self.part = late - self.late  # of a tick: readings are straight between ticks
        depth = int(self.late.max()) + 2
        q, dq = plant.motor_side()
        self.past = np.tile(np.stack([q, dq]), (depth, 1, 1, 1))  # ring of ticks (depth, 2, nrow, 7)
        self.head, self.grid = 0, np.ogrid[: plant.n, :7]

    def push(self) -> None:
        """Store the present tick."""
        self.head = (self.head + 1) % len(self.past)
        self.past[self.head, 0], self.past[self.head, 1] = self.plant.motor_side()

    def read(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, dq, tau (nrow, 7) as the controller and the log get them."""
        p, (q, dq) = self.plant.p, (self._late(kind) for kind in (0, 1))
        q = q + p["offset"] + self.noise["q"][:, self.k]
        step = np.where(p["step"] > 0.0, p["step"], 1.0)
        q = np.where(p["step"] > 0.0, step * np.rint(q / step), q)
        dq, tau = dq + self.noise["dq"][:, self.k], self.plant.gear + self.noise["tau"][:, self.k]
        self.k += 1
        return q, dq, tau

    def _late(self, kind: int) -> np.ndarray:
        """Return the angle (kind 0) or speed (1) of each joint, its delay ago, (nrow, 7)."""
        near, far = (self.past[(self.head - self.late - k) % len(self.past), kind, *self.grid] for k in (0, 1))
        return (1.0 - self.part) * near + self.part * far


class _Delayed:
    """Commands on their way to the drives: each joint sees them its own delay late.

    A tick in which a command takes over gets the mean of both, by their shares of it.
    """

    def __init__(self, plant: Plant):
        self.sub = round(1.0 / RATE / plant.h)
        late = plant.p["delay"] / plant.h
        self.ticks = np.floor(late).astype(int)
        self.part = late - self.ticks
        self.past: list[np.ndarray] = []
        self.keep, self.grid = int(np.ceil(late.max() / self.sub)) + 1, np.ogrid[: plant.n, :7]

    def send(self, u: np.ndarray) -> None:
        """Take the command of this control period."""
        self.past = [u, *self.past[: self.keep - 1]] if self.past else [u] * self.keep

    def at(self, i: int) -> np.ndarray:
        """Return what reaches the drives in tick i of the period, (nrow, 7)."""
        if self.keep == 1:
            return self.past[0]
        past = np.stack(self.past)
        now, before = (past[np.clip(-((i - k - self.ticks) // self.sub), 0, self.keep - 1), *self.grid] for k in (0, 1))
        return (1.0 - self.part) * now + self.part * before
