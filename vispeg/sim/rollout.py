"""Closed-loop rollouts: every (world, segment) pair is a row of one `mujoco.batch`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import effect
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import flange_pose, nominal_of
from vispeg.sim.controller import Controller
from vispeg.sim.observer import Observer
from vispeg.sim.plant import Plant
from vispeg.sim.quiet import quiet
from vispeg.sim.segments.along import apparent_inertia, once
from vispeg.sim.segments.rows import Rows
from vispeg.sim.segments.segment import EXTERNAL, Segment
from vispeg.sim.servo import Servos, stable_step
from vispeg.worlds.world import World

ANGLE, SPEED = 1e3, 1e3  # rad, rad/s: a rollout beyond these has diverged


@dataclass(frozen=True)
class Response:
    """Sensor readings of the simulated robots at the sample times of one segment.

    Attributes:
        q, dq, tau_joint, tau_motor: (nworld, m, nj); rad, rad/s, N m after the gear, N m before it.
        ee: (nworld, m, 7) flange pose computed from the true joint angles, or None if not requested.
        true: (nworld, m, nj) rad, the true joint angles; None if `ee` is None.
        diverged: (nworld,) bool; the rows of a diverged world are NaN.
        diverged_at: (nworld,) time in the segment at which it diverged, s; NaN if it did not.
    """

    q: np.ndarray
    dq: np.ndarray
    tau_joint: np.ndarray
    tau_motor: np.ndarray
    ee: np.ndarray | None
    diverged: np.ndarray
    diverged_at: np.ndarray
    true: np.ndarray | None = None


@dataclass
class ReadingNoise:
    """White noise on the controller's readings: 1-sigma of angle and velocity, (nworld, nj), rad and rad/s.

    With `sensed`, noise is added before the sensors quantize, and responses contain it.
    """

    q: np.ndarray
    dq: np.ndarray
    rng: np.random.Generator
    sensed: bool = False

    def add(self, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Add one tick's noise to readings q, rad, and dq, rad/s, (nsegment * nworld, nj)."""
        copies = len(q) // len(self.q)
        first, second = self.rng.standard_normal((2, *q.shape))
        return q + np.tile(self.q, (copies, 1)) * first, dq + np.tile(self.dq, (copies, 1)) * second


def rounds(world: World) -> bool:
    """Return whether an encoder of the world quantizes, so that noise must be added before quantization."""
    return any(effect(e.effect).resolution({k: v.value for k, v in e.params.items()}) > 0 for e in world.effects)


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
    reading_noise: ReadingNoise | None = None,
) -> list[Response]:
    """Simulate every world through every segment with the commands of the real robot; return one Response per segment.

    Args:
        robot: the nominal robot (declared tool and base tilt included).
        worlds: candidates, of which only the effects are used, not `robot` and `tool`.
        segments: all with the same control mode and tick.
        h_max: greatest physics step, s.
        nthread: threads of the batch.
        observer: keep open-loop rollouts near the measured motion by a soft observer; otherwise they drift away.
        along: linearise the controller's nominal gravity about the segment's measured motion, which suffices for
            candidates near the measurement and costs a third less; exact otherwise.
        want_ee: also return flange poses.
        reading_noise: noise added to the encoder readings of the controller; responses contain the motion it causes,
            and the noise itself only if it is `sensed`.
    """
    run = _Run(robot, worlds, segments, h_max, nthread, observer, along)
    with quiet(), np.errstate(all="ignore"):  # a diverging candidate is an expected result
        return run.responses(want_ee, reading_noise)


class _Run:
    """One batch: the plants, their controller, and an observer if the control is open-loop."""

    def __init__(
        self,
        robot: RobotModel,
        worlds: Sequence[World],
        segments: Sequence[Segment],
        h_max: float,
        nthread: int,
        observer: bool,
        along: bool,
    ):
        self.robot, self.rows, self.tick = robot, Rows(segments, len(worlds)), segments[0].tick
        servo = segments[0].control.mode == "servo"
        h_max = min(h_max, stable_step(robot)) if servo else h_max
        self.nsub = max(1, math.ceil(self.tick / h_max - 1e-9))
        nthread = max(1, min(nthread, self.rows.nsim))
        self.plant = Plant(robot, list(worlds) * len(segments), self.tick / self.nsub, self.tick, nthread, servo)
        self.servos = Servos(self.plant) if servo else None
        self.nominal = nominal_of(robot, self.rows.nsim, nthread)
        self.reference = self.rows.by_tick(lambda s: s.q), self.rows.by_tick(lambda s: s.dq)
        self.controller = Controller(robot, self.rows, self.nominal, self.reference[0], along)
        self.inertia = self.rows.constant(lambda s: once(s, robot, apparent_inertia), len(robot.joints))
        self.external = None  # N m by tick, if an external torque acts on the arm
        if any(EXTERNAL in s.cache for s in segments):
            self.external = self.rows.by_tick(lambda s: s.cache.get(EXTERNAL, np.zeros_like(s.q)))
        self.observer = None
        if observer and self.controller.mode in ("torque", "passive", "unknown"):
            self.observer = Observer(robot, self.rows, self.reference, self.inertia)

    def responses(self, want_ee: bool, noise: ReadingNoise | None) -> list[Response]:
        """Run all ticks and return one response per segment."""
        plant, ticks = self.plant, self.rows.ticks
        q0, dq0 = self.reference[0][0], self.reference[1][0]
        # start in equilibrium: the drives carry the arm's weight
        begun = self.rows.constant(lambda s: s.begun, 1)
        plant.start(q0, dq0, self.nominal.gravity(q0).copy(), self.inertia, begun)
        out = np.empty((4, ticks, *q0.shape))
        true_q = np.empty((ticks, *q0.shape)) if want_ee else None
        before = motor = np.zeros_like(q0)  # N m, torque in the last physics step but one, and in the last
        self.warned = np.zeros(self.rows.nsim, bool)  # rows with a warning of MuJoCo, as of a diverged state
        ends: dict[int, list[int]] = {}
        for i, s in enumerate(self.rows.segments):
            ends.setdefault(s.ticks - 1, []).append(i)
        for k in range(ticks):
            plant.read()
            if noise is not None and noise.sensed:
                out[0, k], out[1, k] = q, dq = plant.measure(noise.add)
            else:
                out[0, k], out[1, k] = q, dq = plant.measure()
            # A servo's torque is a mean over its step: extrapolate it to the tick, before the next goal acts. A single
            # step per tick has no earlier one under the same goal.
            ahead = 0.5 * (motor - before) if self.servos is not None and self.nsub > 1 else 0.0
            out[2, k], out[3, k] = plant.x.tau, motor + ahead
            if true_q is not None:
                true_q[k] = plant.x.q
            if noise is not None and not noise.sensed:
                q, dq = noise.add(q, dq)
            command = self.controller.command(k, q, dq)
            hold = 0.0 if self.observer is None else self.observer.torque(k, q, dq)
            hold = hold if self.external is None else hold + self.external[k]
            for sub in range(self.nsub):
                if sub:
                    plant.read()
                before = motor
                motor = plant.step(command if self.servos is None else self.servos.torque(command), hold)
            for i in ends.get(k, ()):
                self._end(i)
        out[2:, 0] = out[2:, 1]  # there is no torque before the first step
        return [self._response(i, out, true_q) for i in range(len(self.rows.segments))]

    def _end(self, i: int) -> None:
        """Note which rows diverged by the end of segment `i`; what they do after it is ignored."""
        rows = slice(i * self.rows.nworld, (i + 1) * self.rows.nworld)
        self.warned[rows] = self.plant.batch.warning[rows, :, 1].any(axis=1)  # column 1 counts the warnings

    def _response(self, i: int, out: np.ndarray, true_q: np.ndarray | None) -> Response:
        nworld, s = self.rows.nworld, self.rows.segments[i]
        rows = slice(i * nworld, (i + 1) * nworld)
        q, dq, joint, motor = (self._sampled(s, out[c][:, rows]) for c in range(4))
        bad = ~np.all(np.isfinite(q), axis=(1, 2)) | (np.abs(q).max(axis=(1, 2)) > ANGLE) | self.warned[rows]
        far = ~np.all(np.isfinite(q) & (np.abs(q) < ANGLE) & (np.abs(dq) < SPEED), axis=2)
        first = np.where(far.any(axis=1), far.argmax(axis=1), -1)  # the end, if only a warning tells
        at = np.where(bad, s.time[first], np.nan)
        true = None if true_q is None else self._sampled(s, true_q[:, rows])
        ee = None if true is None else flange_pose(self.robot, true)
        for values in (q, dq, joint, motor, *(v for v in (true, ee) if v is not None)):
            values[bad] = np.nan
        return Response(q, dq, joint, motor, ee, bad, at, true)

    def _sampled(self, s: Segment, values: np.ndarray) -> np.ndarray:
        """Interpolate values (ticks, nworld, nj) to the segment's sample times, (nworld, m, nj)."""
        values = np.swapaxes(values, 0, 1)
        ticks = self.rows.ticks
        grid = np.arange(ticks) * self.tick
        if len(s.time) <= ticks and bool(np.all(np.abs(s.time - grid[: len(s.time)]) < 0.05 * self.tick)):
            return values[:, : len(s.time)]
        below = np.clip(np.searchsorted(grid, s.time, side="right") - 1, 0, ticks - 2)
        w = ((s.time - grid[below]) / self.tick)[None, :, None]
        return values[:, below] * (1 - w) + values[:, below + 1] * w
