"""Batched physics with effects: arms that differ from the nominal one respond to a controller's torques.

Steps are interpreted as leapfrog: MuJoCo's semi-implicit Euler is of second order in position if its velocity is taken
as the velocity at the half step. Velocity readings are therefore corrected by half a step of acceleration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import compiled
from vispeg.sim.engine import batch_of
from vispeg.sim.nominal import columns
from vispeg.sim.physics import EffectLoop, Forces, derive
from vispeg.sim.placement import Active, activate
from vispeg.sim.state import DriveState, Fields
from vispeg.worlds.world import World

STIFF_FRICTION = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp at which dry friction stops a joint within one step


class Plant:
    """Arms with effects, one per row of a batch.

    Args:
        robot: the nominal robot.
        worlds: one world per row.
        h: physics step, s.
        tick: control period, s.
        nthread: threads of the batch.
        servo: whether commands are angles for position servos, so that command delays act on angles.
        engine: of the physics, see `vispeg.sim.engine`.

    Attributes:
        x: the state that effects read.
        loop: the active effects.
    """

    x: DriveState

    def __init__(
        self,
        robot: RobotModel,
        worlds: Sequence[World],
        h: float,
        tick: float,
        nthread: int,
        servo: bool = False,
        engine: str = "c",
    ):
        self.robot, self.h, self.tick, self.nsim = robot, h, tick, len(worlds)
        active = self._active(worlds)
        self.model = compiled(robot, (a.effect.name for a in active))
        self.batch = batch_of(engine, self.model, self.nsim, nthread, [a.effect.name for a in active])
        self.qadr = columns([self.model.joint(j).qposadr[0] for j in robot.joints])
        self.vadr = columns([self.model.joint(j).dofadr[0] for j in robot.joints])
        self.u = columns([self.model.actuator(j).id for j in robot.joints])
        self.loop = EffectLoop(active, servo)
        self.active = self.loop.active
        self.batch.expand("opt.timestep")[:] = h
        self._write()

    def _active(self, worlds: Sequence[World]) -> list[Active]:
        return activate(self.robot, worlds)

    def _write(self) -> None:
        """Write the effects that are values of model fields."""
        fields = Fields(self.batch, self.robot)
        for a in self.active:
            a.effect.write(fields, a.p)
        derive(self.batch, fields)
        self.dry: np.ndarray | None = None
        if self.loop.frictions or "dof_frictionloss" in fields.touched:
            self.dry = self.batch.expand("dof_frictionloss")[:, self.vadr].copy()
            self.batch.expand("dof_solref")[:, self.vadr] = (2 * self.h, 1.0)
            self.batch.expand("dof_solimp")[:, self.vadr] = STIFF_FRICTION
        self.armature, self.damping = self._row_field("dof_armature"), self._row_field("dof_damping")
        self.damped, self.lag_gain = bool(self.damping.any()), self.damping * self.h

    def _row_field(self, name: str) -> np.ndarray:
        value = self.batch.expanded(name)
        if value is None:
            value = np.broadcast_to(getattr(self.model, name), (self.nsim, self.model.nv))
        return value[:, self.vadr]

    def start(
        self, q: np.ndarray, dq: np.ndarray, weight: np.ndarray, inertia: np.ndarray, begun: np.ndarray | float = 0.0
    ) -> None:
        """Set the arms to the state at which their encoders stand at q (nsim, nj) rad and dq rad/s.

        Args:
            q, dq: measured motion at the first tick.
            weight: (nsim, nj) N m, drive torque at equilibrium there.
            inertia: (nsim, nj) apparent inertia for effects, kg m^2.
            begun: time on the recording's clock, s: (nsim, 1), or a number.
        """
        b = self.batch
        self.qpos, self.qvel = b.bind("qpos"), b.bind("qvel")
        self.ctrl, self.applied = b.bind("ctrl"), b.bind("qfrc_applied")
        self.acc = np.zeros((self.nsim, len(self.robot.joints)))  # actual acceleration in the last step
        self.damper, self.constraint = b.bind("qfrc_damper"), b.bind("qfrc_constraint")
        self.qpos[:, self.qadr] = q
        self.qvel[:, self.vadr] = dq
        self.half = np.zeros_like(self.acc)
        self.first, self.pushed = True, False  # pushed: `applied` is not 0 any more and must be written
        clock = np.zeros((self.nsim, 1)) + begun
        still = np.zeros_like(self.acc)
        self.x = DriveState(self.h, self.tick, q.copy(), dq.copy(), still, weight.copy(), inertia, clock)
        self.loop.begin(self.x)
        if self.loop.senses:  # the encoders, not the links, start at the measured angles
            self.qpos[:, self.qadr] += q - self.loop.unrounded(self.x)
            self.x.q = self.qpos[:, self.qadr].copy()
            self.loop.begin(self.x)

    def read(self) -> None:
        """Store the current true joint motion in `x`."""
        self.x.q = self.qpos[:, self.qadr].copy()
        self.x.ddq = self.acc
        self.half = 0.5 * self.h * self.acc
        self.x.dq = self.qvel[:, self.vadr] + self.half

    def measure(
        self, noise: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] = lambda q, dq: (q, dq)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the encoder readings of `x` with `noise`: (nsim, nj) rad and rad/s."""
        return self.loop.read(*noise(self.x.q, self.x.dq), self.x)

    def forces(self, command: np.ndarray) -> Forces:
        """Compute the effects' torques in the coming step for `command` (nsim, nj) N m; also set the dry friction."""
        forces = self.loop.forces(command, self.x, self.dry)
        if forces.friction is not None:
            self.batch.expand("dof_frictionloss")[:, self.vadr] = forces.friction
        return forces

    def step(self, command: np.ndarray, hold: np.ndarray | float) -> np.ndarray:
        """Step the physics; return the motor torque (nsim, nj) N m.

        Args:
            command: (nsim, nj) commanded torque, N m.
            hold: (nsim, nj) torque on the links, N m, held over the step as the command is, or a number.
        """
        forces = self.forces(command)
        tau = forces.drive
        # leapfrog: the velocity update spans half of the last step and half of this one
        sent, held = (tau, hold) if self.first else (0.5 * (tau + self.last[0]), 0.5 * (hold + self.last[1]))
        self.last = tau, hold
        self.ctrl[:, self.u] = sent
        other = held if forces.other is None else forces.other + held
        self._apply(other)
        # velocity-dependent forces use the velocity at the whole step, the position that at the half step
        half, before = self.half, self.x.dq
        self.qvel[:, self.vadr] = before
        self.batch.step()
        # not qacc: it leaves out the implicit damping, so this would diverge if damping exceeds 2 J / h
        velocity, angle = self.qvel[:, self.vadr], self.qpos[:, self.qadr]
        self.acc = velocity - before
        self.acc /= self.h
        if self.first:  # began with the velocity at a whole step, so only half of this update counts
            half, self.first = 0.5 * self.h * self.acc, False
        self.qvel[:, self.vadr] = velocity - half
        self.qpos[:, self.qadr] = angle - self.h * half
        # torque from the drive on the link, so less damping, dry friction and the rotor's acceleration
        self.x.tau = tau if forces.geared is None else tau + forces.geared
        if self.damped:
            self.x.tau = self.x.tau + self.damper[:, self.vadr]
        self.x.tau = self.x.tau + self.constraint[:, self.vadr]
        self.x.tau -= self.armature * self.acc
        self.x.t = self.x.t + self.h
        return forces.motor

    def _apply(self, torque: np.ndarray | float) -> None:
        """Apply the torques other than the motors'. MuJoCo's implicit damping acts a step late; this is compensated."""
        if self.damped:
            torque = torque + self.lag_gain * self.x.ddq
        if self.pushed or np.ndim(torque) or torque:
            self.applied[:, self.vadr] = torque
            self.pushed = True
