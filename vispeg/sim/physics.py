"""Evaluate all effects in a physics step: one place for identification, inverse dynamics and training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vispeg.effects.common.delay import DelayLine
from vispeg.sim.placement import Active
from vispeg.sim.state import DriveState, Fields

OVERLAP = 1e-8  # m, tolerance of the contact search, see `exact`
# Factor on the regularization of the dry friction that holds a part, see `firm`. The part then creeps at 0.4 um/s under
# 25 N, or 7 um while it is pressed for 18 s. With a factor of 0.001 the solver does not converge when the force comes
# near the friction limit.
FIRM = 0.02
GEAR = 80  # drive stages of this order or higher act after the motor, so its current does not show them


@dataclass(frozen=True)
class Forces:
    """Torques from the effects in one physics step, each (nsim, nj) N m.

    Attributes:
        drive: torque at the output of the last drive stage.
        motor: torque before the gear, as computed from the motor's current and nominal constants (`inverse`).
        geared: torque of effects inside the drive, which a sensor after the gear measures; None if there are none.
        link: torque of effects that act on the link; None if there are none.
        friction: level of the joints' dry friction; None if it stays at the model's own constant value.
    """

    drive: np.ndarray
    motor: np.ndarray
    geared: np.ndarray | None
    link: np.ndarray | None
    friction: np.ndarray | None

    @property
    def other(self) -> np.ndarray | None:
        """Return the torque other than the drive's: the sum of `geared` and `link`; None if there is none."""
        return total(self.geared, self.link)


class EffectLoop:
    """The active effects of a batch, in the order of their drive stage, with their states.

    Args:
        active: effects with their parameters.
        goals: whether commands are angles for position servos instead of torques for drives.
    """

    def __init__(self, active: Sequence[Active], goals: bool = False):
        self.active = list(active)
        self.goals = [a for a in active if goals and a.effect.overrides("goal")]
        self.drives = [a for a in active if a.effect.overrides("drive") and a not in self.goals]
        self.frictions = [a for a in active if a.effect.overrides("friction")]
        self.torques = [a for a in active if a.effect.overrides("torque")]
        self.senses = [a for a in active if a.effect.overrides("observe")]
        # what a servo's own loop reads: sensor effects with a state (noise, delay, gaps) act on logged readings
        self.inside = [a for a in self.senses if a.effect.family == "joint" or not a.effect.overrides("start")]
        self.wrists = [a for a in active if a.effect.overrides("wrench")]
        self.inverses = [a for a in active if a.effect.overrides("inverse")]
        self.states: dict[str, Any] = {a.effect.name: None for a in active}

    @property
    def acts(self) -> bool:
        """Whether any effect must be evaluated in each physics step."""
        return bool(self.drives or self.frictions or self.torques)

    @property
    def foreseen(self) -> bool:
        """Whether the effects evaluated in each physics step depend on the command alone, not on the motion."""
        return all(a.effect.commanded for a in self.drives) and not (self.frictions or self.torques)

    def begin(self, x: DriveState) -> None:
        """Initialise all rows at the state `x`."""
        self.states = {a.effect.name: a.effect.start(x, a.p) for a in self.active}

    def restart(self, x: DriveState, rows: np.ndarray) -> None:
        """Reset rows (indices) to the state `x`; the others continue."""
        for a in self.active:
            name = a.effect.name
            self.states[name] = merged(self.states[name], a.effect.start(x, a.p), rows)

    def forces(self, command: np.ndarray, x: DriveState, dry: np.ndarray | None) -> Forces:
        """Compute one step's torques for `command` and the model's own dry friction `dry`, both (nsim, nj) N m."""
        tau, motor = self.drive(command, x)
        level = self.friction(x, dry) if self.frictions and dry is not None else None
        return Forces(tau, motor, *self.torque(x), level)

    def drive(self, command: np.ndarray, x: DriveState) -> tuple[np.ndarray, np.ndarray]:
        """Return one step's torques of the drives, and of their motors as currents show them, (nsim, nj) N m each."""
        tau, motor = command, None
        for a in self.drives:
            if motor is None and a.effect.order >= GEAR:
                motor = tau
            tau = a.effect.drive(self.states[a.effect.name], tau, x, a.p)
        return tau, self.inverse(tau if motor is None else motor, "motor")

    def friction(self, x: DriveState, dry: np.ndarray) -> np.ndarray:
        """Return the level (nsim, nj) N m of dry friction, given the model's own."""
        level = dry.copy()
        for a in self.frictions:
            level += a.effect.friction(self.states[a.effect.name], x, a.p)
        return level

    def torque(self, x: DriveState) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Return the torques (nsim, nj) N m that no actuator commands: inside the drive, and on the link."""
        geared, link = None, None
        for a in self.torques:
            t = a.effect.torque(self.states[a.effect.name], x, a.p)
            if a.effect.side() == "drive":
                geared = total(geared, t)
            else:
                link = total(link, t)
        return geared, link

    def along(self, x: DriveState, path: np.ndarray, at: np.ndarray) -> np.ndarray | None:
        """Return effect torques (n, nj) N m along a measured motion `x`: samples `at` of `path` (npath, nj) rad.

        Effects with a state from step to step are left out, except those whose state depends on the path alone.
        None if no effect acts.
        """
        out = None
        for a in self.torques:
            if a.effect.overrides("along"):
                out = total(out, a.effect.along(path, at, x, a.p))
            elif not a.effect.overrides("start"):
                out = total(out, a.effect.torque(None, x, a.p))
        return out

    def read(self, q: np.ndarray, dq: np.ndarray, x: DriveState) -> tuple[np.ndarray, np.ndarray]:
        """Return the encoder readings of q (nsim, nj) rad and dq rad/s."""
        for a in self.senses:
            q, dq = a.effect.observe(self.states[a.effect.name], q, dq, x, a.p)
        return q, dq

    def goal(self, goal: np.ndarray, x: DriveState) -> np.ndarray:
        """Return the goals (nsim, nj) rad as they reach the servo loops."""
        for a in self.goals:
            goal = a.effect.goal(self.states[a.effect.name], goal, x, a.p)
        return goal

    def feedback(self, x: DriveState) -> tuple[np.ndarray, np.ndarray]:
        """Return the angle (nsim, nj) rad and velocity rad/s that a servo's own loop reads."""
        q, dq = x.q, x.dq
        for a in self.inside:
            q, dq = a.effect.observe(self.states[a.effect.name], q, dq, x, a.p)
        return q, dq

    def unrounded(self, x: DriveState) -> np.ndarray:
        """Return the angle (nsim, nj) rad at which the encoders stand, before rounding, noise and delay."""
        q, dq = x.q, x.dq
        for a in self.inside:
            if not a.effect.overrides("resolution"):
                q, dq = a.effect.observe(self.states[a.effect.name], q, dq, x, a.p)
        return q

    def feel(self, wrench: np.ndarray, x: DriveState) -> np.ndarray:
        """Return the wrist sensor's reading of a wrench (nsim, 6) N, N m; call once per control tick."""
        for a in self.wrists:
            wrench = a.effect.wrench(self.states[a.effect.name], wrench, x, a.p)
        return wrench

    def delivered(self, command: np.ndarray) -> np.ndarray:
        """Return the torque (n, nj) N m of the drives for `command`, N m; `inverse` with "motor" undoes it."""
        for a in self.inverses:
            command = a.effect.drive(None, command, None, a.p)
        return command

    def inverse(self, needed: np.ndarray, sensor: str) -> np.ndarray:
        """Return the reading (n, nj) N m of a torque sensor (`joint` or `motor`) if the link needs `needed`, N m."""
        for a in reversed(self.inverses) if sensor == "motor" else self.inverses:
            needed = a.effect.inverse(needed, sensor, a.p)
        return needed


def total(a: np.ndarray | None, b: np.ndarray | None) -> np.ndarray | None:
    """Add two torques, each of which may be None."""
    return b if a is None else a if b is None else a + b


def exact(batch: Any) -> None:
    """Set the precision of a batch's contact search to `OVERLAP`.

    At MuJoCo's default of 1e-6 m, the contact normal of two meshes that overlap by less may point the wrong way: a
    sliding body is then pulled down in some steps, chatters, and drags by more than its friction.
    """
    batch.expand("opt.ccd_tolerance")[:] = OVERLAP


def firm(batch: Any, model: Any, joint: str, rows: np.ndarray | slice = slice(None)) -> None:
    """Reduce the creep of a joint that dry friction holds, without changing the force at which it slips.

    Only the given rows of the batch are changed, by default all.

    MuJoCo regularizes friction by `R = (1 - d) / d w` with the joint's inverse weight w; d is at most 0.9999. Under
    a force f a joint at rest therefore creeps at `f R / b`, 20 um/s for a held part under 25 N; real dry friction does
    not creep. So w = `dof_invweight0` is scaled down by FIRM, which affects nothing else for a joint without a limit.
    Call this after `derive`, which sets that field. Source: MuJoCo 4.0 manual, Computation, Constraint model, Friction
    loss.
    """
    batch.expand("dof_invweight0")[rows, model.joint(joint).dofadr[0]] *= FIRM


def derive(batch: Any, fields: Fields, rows: np.ndarray | None = None) -> None:
    """Update the constants that MuJoCo derives from model fields, without losing the values that effects wrote.

    `rows` are the indices of the rows in which fields have changed, by default all.
    `set_const` resets spring references and the like from `qpos0`, which would undo an effect that writes them.
    """
    if not fields.touched:
        return
    keep = {n: batch.expand(n).copy() for n in fields.touched if n.startswith("qpos")}
    batch.set_const(rows)
    for name, values in keep.items():
        batch.expand(name)[:] = values


def merged(old: Any, new: Any, rows: np.ndarray) -> Any:
    """Return the effect state `old` with `rows` (indices) replaced from `new`, a new state from `Effect.start`.

    States are None, arrays whose leading axis is the simulation, delay lines, or dicts and tuples of these.

    Raises:
        TypeError: a state of another type, whose rows cannot be reset separately.
    """
    if isinstance(old, dict):
        return {k: merged(v, new[k], rows) for k, v in old.items()}
    if isinstance(old, tuple):
        return tuple(merged(a, b, rows) for a, b in zip(old, new, strict=True))
    if isinstance(old, np.ndarray):
        old = old.copy()
        old[rows] = new[rows]
        return old
    if isinstance(old, DelayLine):
        old.forget(rows)
        return old
    if old is None:
        return new
    raise TypeError(f"an effect's state of type {type(old).__name__} cannot be reset row by row")
