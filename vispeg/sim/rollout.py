"""Closed-loop rollouts: every (world, segment) pair is a row of one `mujoco.batch`.

The physics is stepped as leapfrog: MuJoCo's semi-implicit Euler positions are second order when its velocity is read as
that of the half step, so velocities are corrected by half a step of acceleration where they are read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import batch as mjb

from vispeg.control.laws import osc, position, rotation_vector
from vispeg.core.world import World
from vispeg.robots.model import RobotModel
from vispeg.sim.nominal import Nominal, dense, quat
from vispeg.sim.placement import Active, activate
from vispeg.sim.segment import Segment
from vispeg.sim.state import DriveState, Fields

GEAR = 80  # drive stages from here on lie behind the motor, where its current no longer tells
OBSERVER = 8.0  # rad/s: how softly an open-loop (torque, passive) rollout is held to the measured motion
STIFF_FRICTION = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # impedance at which dry friction stops a joint within one step


@dataclass(frozen=True)
class Response:
    """What the sensors of the simulated robots read at the sample times of one segment.

    Attributes:
        q, dq, tau_joint, tau_motor: (nworld, m, nj); rad, rad/s, N m behind the gear, N m before it.
        ee: (nworld, m, 7) flange pose from the measured angles' true values, or None where not asked for.
        diverged: (nworld,) bool; the rows of a diverged world are NaN.
    """

    q: np.ndarray
    dq: np.ndarray
    tau_joint: np.ndarray
    tau_motor: np.ndarray
    ee: np.ndarray | None
    diverged: np.ndarray


def simulate(
    robot: RobotModel,
    worlds: Sequence[World],
    segments: Sequence[Segment],
    *,
    h_max: float = 1e-3,
    nthread: int = 1,
    observer: bool = True,
    along: bool = False,
    want_ee: bool = False,
) -> list[Response]:
    """Drives every world through every segment as the robot was driven; one Response a segment.

    Args:
        robot: the nominal robot (declared tool and base tilt included).
        worlds: candidates; their `robot` and `tool` are not read, only their effects.
        segments: all with the same control mode and tick.
        h_max: greatest physics step, s.
        nthread: threads of the batch.
        observer: hold torque-driven rollouts softly to the measured motion (they drift without bound otherwise).
        along: take the controller's nominal gravity to first order about the segment's measured motion, which is what
            candidates near the measurement need at a third less cost; exact otherwise.
        want_ee: also return flange poses.
    """
    run = _Run(robot, worlds, segments, h_max, nthread, observer, along)
    with _quiet(), np.errstate(all="ignore"):  # a diverging candidate is an answer, not news
        return run.responses(want_ee)


def observer_spring(robot: RobotModel, inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness N m/rad and damping N m s/rad that the observer adds at each joint of apparent `inertia` (..., nj).

    A light wrist held by its inertia alone would be thrown a radian off by half a newton metre; what a drive can be
    wrong by goes with its torque limit, so half of that a radian is added, and the damping that goes with it.
    """
    limit = np.where(np.isfinite(robot.torque_limit), robot.torque_limit, 100.0)
    stiffness = np.minimum(0.5 * limit, (40.0**2) * inertia)
    return stiffness, 1.4 * np.sqrt(stiffness * inertia)


@contextmanager
def _quiet() -> Iterator[None]:
    """MuJoCo's instability warnings held back; divergence is reported in `Response.diverged`."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


class _Run:
    def __init__(self, robot, worlds, segments, h_max, nthread, observer, along=False):
        self.robot, self.segments, self.nworld = robot, segments, len(worlds)
        self.mode, self.tick = segments[0].control.mode, segments[0].tick
        self.along = along and self.mode == "position"
        self.nsub = max(1, math.ceil(self.tick / h_max - 1e-9))
        self.h = self.tick / self.nsub
        self.ticks = max(s.ticks for s in segments)
        self.nsim = self.nworld * len(segments)  # row = segment * nworld + world
        self.model = compiled(robot)
        nthread = max(1, min(nthread, self.nsim))
        self.batch = mjb.Batch(self.model, self.nsim, nthread=nthread)
        self.nominal = Nominal(self.model, robot.joints, robot.flange, self.nsim, nthread)
        self.qadr, self.vadr = self.nominal.qadr, self.nominal.vadr
        self.u = np.array([self.model.actuator(j).id for j in robot.joints])
        self.active = activate(robot, list(worlds) * len(segments))
        self.batch.expand("opt.timestep")[:] = self.h
        self._write()
        self._commands(observer)

    # Set-up ---------------------------------------------------------------------------------------------------
    def _write(self):
        """Effects that are numbers in the model."""
        fields = Fields(self.batch, self.robot)
        for a in self.active:
            a.effect.write(fields, a.p)
        if fields.touched:
            keep = {n: self.batch.expand(n).copy() for n in fields.touched if n.startswith("qpos")}
            self.batch.set_const()
            for name, values in keep.items():  # set_const derives the spring references anew
                self.batch.expand(name)[:] = values
        self.friction = [a for a in self.active if a.effect.overrides("friction")]
        if self.friction or "dof_frictionloss" in fields.touched:
            self.loss = self.batch.expand("dof_frictionloss")
            self.dry = self.loss[:, self.vadr].copy()
            self.batch.expand("dof_solref")[:, self.vadr] = (2 * self.h, 1.0)
            self.batch.expand("dof_solimp")[:, self.vadr] = STIFF_FRICTION
        self.drives = [a for a in self.active if a.effect.overrides("drive")]
        self.extra = [a for a in self.active if a.effect.overrides("torque")]
        self.senses = [a for a in self.active if a.effect.overrides("observe")]
        self.armature, self.damping = self._row_field("dof_armature"), self._row_field("dof_damping")
        self.damped = bool(self.damping.any())

    def _row_field(self, name):
        value = self.batch.expanded(name)
        if value is None:
            value = np.broadcast_to(getattr(self.model, name), (self.nsim, self.model.nv))
        return value[:, self.vadr]

    def _rows(self, get):
        """Commands by tick: each segment's, held at its end, repeated for every world only when read."""
        held = []
        for s in self.segments:
            value = get(s)
            held.append(np.concatenate([value, np.repeat(value[-1:], self.ticks - len(value), axis=0)]))
        return _ByTick(np.stack(held, axis=1), self.nworld)

    def _gains(self, get, width):
        rows = [np.broadcast_to(get(s), (self.nworld, width)) for s in self.segments]
        return np.concatenate(rows)

    def _commands(self, observer):
        nj = len(self.robot.joints)
        self.comp = np.concatenate(
            [np.full((self.nworld, 1), float(s.control.gravity_compensation == "model")) for s in self.segments]
        )
        self.reference = self._rows(lambda s: s.q), self._rows(lambda s: s.dq)
        self.holds = observer and self.mode in ("torque", "passive", "unknown")
        if self.mode in ("position", "osc"):
            width = nj if self.mode == "position" else 6
            self.kp = self._gains(lambda s: s.control.kp, width)
            self.kd = self._gains(lambda s: s.control.kd, width)
        if self.mode == "position":
            self.q_cmd = self._rows(lambda s: s.command["q_cmd"])
            self.dq_cmd = self._rows(lambda s: s.command.get("dq_cmd", np.zeros_like(s.q)))
        elif self.mode == "osc":
            self.ee_cmd = self._rows(lambda s: s.command["ee_cmd"])
        elif self.mode == "torque":
            self.tau_cmd = self._rows(lambda s: s.command["tau_cmd"] + self._once(s, self._measured_gravity))
        if self.along and self.comp.any():
            self.gravity0 = self._rows(lambda s: self._once(s, self._tangent)[0])
            self.gravity1 = self._rows(lambda s: self._once(s, self._tangent)[1])
        self.inertia = np.concatenate(
            [np.repeat(self._once(s, self._apparent)[None], self.nworld, 0) for s in self.segments]
        )
        self.spring = observer_spring(self.robot, self.inertia)
        if self.holds:
            self.mass = self._rows(lambda s: self._once(s, self._inertia))

    def _once(self, s: Segment, get):
        """`get(s)`, remembered with the segment for this robot."""
        key = (get.__name__, id(self.robot))
        if key not in s.known:
            s.known[key] = get(s)
        return s.known[key]

    def _measured_gravity(self, s: Segment):
        """Gravity torque the robot itself added below `tau_cmd`, from the angles that it read."""
        if s.control.gravity_compensation != "model":
            return np.zeros_like(s.q)
        return Nominal(self.model, self.robot.joints, self.robot.flange, s.ticks, 1).gravity(s.q_raw).copy()

    def _tangent(self, s: Segment, step: float = 1e-4):
        """Nominal gravity (n, nj) along the measured motion and its derivative (n, nj, nj) by central differences."""
        n, nj = s.q.shape
        nominal = Nominal(self.model, self.robot.joints, self.robot.flange, n, 1)
        slope = np.empty((n, nj, nj))
        for j in range(nj):
            move = np.eye(nj)[j] * step
            slope[:, :, j] = (nominal.gravity(s.q + move).copy() - nominal.gravity(s.q - move)) / (2 * step)
        return nominal.gravity(s.q).copy(), slope

    def _mass(self, q):
        """Nominal inertia (n, nj, nj) along a motion."""
        nominal = Nominal(self.model, self.robot.joints, self.robot.flange, len(q), 1)
        return nominal.operational(q)[0]

    def _inertia(self, s: Segment):
        return self._mass(s.q)

    def _apparent(self, s: Segment):
        some = s.q[:: max(1, s.ticks // 16)]
        return np.min(1.0 / np.diagonal(np.linalg.inv(self._mass(some)), axis1=1, axis2=2), axis=0)

    # The loop -------------------------------------------------------------------------------------------------
    def _start(self):
        b = self.batch
        self.qpos, self.qvel = b.bind("qpos"), b.bind("qvel")
        self.ctrl, self.applied = b.bind("ctrl"), b.bind("qfrc_applied")
        self.acc = np.zeros((self.nsim, len(self.robot.joints)))  # what the last step really did
        self.damper, self.constraint = b.bind("qfrc_damper"), b.bind("qfrc_constraint")
        self.qpos[:, self.qadr] = self.reference[0][0]
        self.qvel[:, self.vadr] = self.reference[1][0]
        self.last = self.nominal.gravity(self.reference[0][0]).copy()
        zeros = np.zeros((self.nsim, len(self.robot.joints)))
        self.x = DriveState(
            self.h,
            self.tick,
            self.reference[0][0].copy(),
            self.reference[1][0].copy(),
            zeros.copy(),
            zeros.copy(),
            self.inertia,
        )
        # a robot that starts in equilibrium carries its weight
        self.x.tau[:] = self.nominal.gravity(self.x.q)
        self._begin()
        if self.senses:  # the encoders, not the links, start at the measured angles
            self.qpos[:, self.qadr] += self.reference[0][0] - self._measure()[0]
            self.x.q = self.qpos[:, self.qadr].copy()
            self._begin()

    def _begin(self):
        self.states = {a.effect.name: a.effect.start(self.x, a.p) for a in self.active}

    def _read(self):
        """True joint motion at this instant."""
        self.x.q = self.qpos[:, self.qadr].copy()
        self.x.ddq = self.acc
        self.x.dq = self.qvel[:, self.vadr] + 0.5 * self.h * self.x.ddq

    def _measure(self):
        q, dq = self.x.q, self.x.dq
        for a in self.senses:
            q, dq = a.effect.observe(self.states[a.effect.name], q, dq, self.x, a.p)
        return q, dq

    def _control(self, k, q, dq):
        if self.mode == "position":
            tau = position(self.q_cmd[k], self.dq_cmd[k], q, dq, self.kp, self.kd)
            return tau + self.comp * self._gravity(k, q) if self.comp.any() else tau
        if self.mode == "osc":
            return self._osc(k, q, dq)
        tau = self.tau_cmd[k] if self.mode == "torque" else np.zeros_like(q)
        return tau

    def _gravity(self, k, q):
        if not self.along:
            return self.nominal.gravity(q)
        return self.gravity0[k] + np.einsum("nij,nj->ni", self.gravity1[k], q - self.reference[0][k])

    def _osc(self, k, q, dq):
        mass, jac, pos, rot, gravity = self.nominal.operational(q)
        goal = self.ee_cmd[k]
        error = np.concatenate([goal[:, :3] - pos, rotation_vector(rot, goal[:, 3:])], axis=1)
        twist = np.einsum("nij,nj->ni", jac, dq)
        posture = None
        null = self.segments[0].control.nullspace
        if null is not None:
            posture = np.einsum("nij,nj->ni", mass, null.kp * (null.q - q) - null.kd * dq)
        return osc(error, twist, mass, jac, self.kp, self.kd, posture) + self.comp * gravity

    def _hold(self, k):
        """Soft observer M (w^2 e + 2 w de) + K e + D de: keeps an open-loop rollout near the measured motion."""
        e = self.reference[0][k] - self._encoder[0]
        de = self.reference[1][k] - self._encoder[1]
        return np.einsum("nij,nj->ni", self.mass[k], OBSERVER**2 * e + 2 * OBSERVER * de) + (
            self.spring[0] * e + self.spring[1] * de
        )

    def responses(self, want_ee: bool) -> list[Response]:
        self._start()
        nj = len(self.robot.joints)
        out = np.empty((4, self.ticks, self.nsim, nj))
        true_q = np.empty((self.ticks, self.nsim, nj)) if want_ee else None
        motor = np.zeros((self.nsim, nj))
        for k in range(self.ticks):
            self._read()
            self._encoder = self._measure()
            out[0, k], out[1, k] = self._encoder
            out[2, k], out[3, k] = self.x.tau, motor
            if true_q is not None:
                true_q[k] = self.x.q
            command = self._control(k, *self._encoder)
            hold = self._hold(k) if self.holds else 0.0
            for sub in range(self.nsub):
                if sub:
                    self._read()
                motor = self._step(command, hold)
        out[2:, 0] = out[2:, 1]  # nothing was measured before the first step
        return [self._response(i, out, true_q) for i in range(len(self.segments))]

    def _step(self, command, hold):
        tau = command
        motor = None
        for a in self.drives:
            if motor is None and a.effect.order >= GEAR:
                motor = tau
            tau = a.effect.drive(self.states[a.effect.name], tau, self.x, a.p)
        motor = tau if motor is None else motor
        if self.friction:
            level = self.dry.copy()
            for a in self.friction:
                level += a.effect.friction(self.states[a.effect.name], self.x, a.p)
            self.loss[:, self.vadr] = level
        drive_side, link_side = np.zeros_like(tau), hold
        for a in self.extra:
            t = a.effect.torque(self.states[a.effect.name], self.x, a.p)
            if a.effect.side() == "drive":
                drive_side = drive_side + t
            else:
                link_side = link_side + t
        self.ctrl[:, self.u] = 0.5 * (tau + self.last)  # the kick spans half of the last step and half of this one
        self.last = tau
        self.applied[:, self.vadr] = drive_side + link_side
        if self.damped:  # MuJoCo damps at the end of the step, which is stable but a step late: give that step back
            self.applied[:, self.vadr] += self.damping * self.h * self.x.ddq
        # velocity forces act at the whole step, the position moves with the half step's
        half = 0.5 * self.h * self.x.ddq
        before = self.qvel[:, self.vadr] + half
        self.qvel[:, self.vadr] = before
        self.batch.step()
        # not qacc, which leaves out the implicit damping and so diverges past 2 J / h
        self.acc = (self.qvel[:, self.vadr] - before) / self.h
        self.qvel[:, self.vadr] -= half
        self.qpos[:, self.qadr] -= self.h * half
        self.x.tau = (
            tau + drive_side + self.damper[:, self.vadr] + self.constraint[:, self.vadr] - self.armature * self.acc
        )
        return motor

    def _response(self, i: int, out, true_q) -> Response:
        s = self.segments[i]
        rows = slice(i * self.nworld, (i + 1) * self.nworld)
        grid = np.arange(self.ticks) * self.tick
        exact = len(s.time) <= self.ticks and bool(np.all(np.abs(s.time - grid[: len(s.time)]) < 0.05 * self.tick))

        def sampled(values):  # (ticks, nworld, nj) -> (nworld, m, nj)
            values = np.swapaxes(values, 0, 1)
            if exact:
                return values[:, : len(s.time)]
            left = np.clip(np.searchsorted(grid, s.time, side="right") - 1, 0, self.ticks - 2)
            w = ((s.time - grid[left]) / self.tick)[None, :, None]
            return values[:, left] * (1 - w) + values[:, left + 1] * w

        q, dq, joint, motor = (sampled(out[c][:, rows]) for c in range(4))
        bad = (
            ~np.all(np.isfinite(q), axis=(1, 2))
            | (np.abs(q).max(axis=(1, 2)) > 1e3)
            | self.batch.warning[rows, :, 1].any(axis=1)
        )
        for values in (q, dq, joint, motor):
            values[bad] = np.nan
        ee = None
        if true_q is not None:
            ee = flange_pose(self.robot, sampled(true_q[:, rows]))
        return Response(q, dq, joint, motor, ee, bad)


class _ByTick:
    """`rows[k]` is (nsim, ...) at tick k, from (ticks, nsegment, ...)."""

    def __init__(self, values: np.ndarray, nworld: int):
        self.values, self.nworld = values, nworld

    def __getitem__(self, k: int) -> np.ndarray:
        return np.repeat(self.values[k], self.nworld, axis=0)


_COMPILED: dict[int, mujoco.MjModel] = {}


def compiled(robot: RobotModel) -> mujoco.MjModel:
    """The robot's compiled model with the solver settings of rollouts; cached by the robot object."""
    key = id(robot)
    if key not in _COMPILED:
        model = robot.spec().compile()
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        _COMPILED[key] = model
        _KEEP.append(robot)
    return _COMPILED[key]


_KEEP: list[RobotModel] = []  # ids stay unique while the robots live


def flange_pose(robot: RobotModel, q: np.ndarray) -> np.ndarray:
    """Nominal flange pose (..., 7) x y z qw qx qy qz in the base for joint angles (..., nj)."""
    flat = q.reshape(-1, q.shape[-1])
    nominal = Nominal(compiled(robot), robot.joints, robot.flange, len(flat), 1)
    _, _, pos, rot, _ = nominal.operational(np.nan_to_num(flat))
    return np.concatenate([pos, rot], axis=1).reshape(*q.shape[:-1], 7)


__all__ = ["Response", "simulate", "compiled", "flange_pose", "Active", "dense", "quat"]
