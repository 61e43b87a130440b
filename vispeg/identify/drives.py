"""Drive torque of each joint along a measured motion, computed from a known controller, or measured.

A recording with such a torque can be compared by inverse dynamics, whatever its controller; `diagnosis.proposal` does
so. Motion and torque pass the same zero-phase low-pass, so a law that is linear in the torques also holds for the
filtered ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from vispeg.control.laws import position
from vispeg.core.effect import effect
from vispeg.identify.inverse import MOTION_HZ, TorqueEvidence, long_runs, rigid_body
from vispeg.identify.loops.runaway import without_runaway
from vispeg.identify.loops.soft import as_torque_controlled
from vispeg.identify.nominal import nominal_robot, robot_of
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.noise import noise_of
from vispeg.recordings.recording import Control, Recording
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import nominal_of
from vispeg.sim.placement import activate
from vispeg.worlds.world import World

SPEED_HZ = 40.0  # bandwidth of velocities computed from angles, where none were recorded
LEAST = 2.0  # s: where the arm is lost, a part of an episode before or after it must be longer (`without_runaway`)
ROWS = 4096  # postures whose gravity torques are computed at a time


def sent(rec: Recording, robot: RobotModel) -> np.ndarray | None:
    """Return the torque that the controller sent, (n, nj) N m at the samples, gravity compensation included.

    None if it is unknown, as under a servo's own loop. A command is held for one control period, so on average it acts
    half a period later; the result is shifted by that.
    """
    c = rec.control
    if c.mode == "passive":
        return np.zeros_like(rec.q)
    if c.mode == "torque":
        tau = rec.tau_cmd
    elif c.mode == "position" and rec.q_cmd is not None and c.kp is not None and c.kd is not None:
        goal = np.zeros_like(rec.q) if rec.dq_cmd is None else rec.dq_cmd
        speed = smooth(rec.time, rec.q, SPEED_HZ, rec.episode)[1] if rec.dq is None else rec.dq
        tau = position(rec.q_cmd, goal, rec.q, speed, c.kp, c.kd)
    elif c.mode == "osc" and rec.ee_cmd is not None:
        tau = as_torque_controlled(rec, robot).tau_cmd
    else:
        return None
    if tau is None:
        return None
    if c.gravity_compensation == "model":
        q = np.nan_to_num(rec.q)
        parts = [q[k : k + ROWS] for k in range(0, len(q), ROWS)]
        tau = tau + np.concatenate([nominal_of(robot, len(part)).operational(part)[4] for part in parts])
    number = np.zeros(len(rec.time), int) if rec.episode is None else rec.episode
    out = np.empty_like(tau)
    for n in np.unique(number):
        rows = np.flatnonzero(number == n)
        time = rec.time[rows]
        out[rows] = np.stack([np.interp(time, time + 0.5 / c.rate_hz, joint) for joint in tau[rows].T], axis=1)
    return out


def with_drive_torque(rec: Recording) -> Recording | None:
    """Return the recording with its drive torque as `tau`, low-passed, and no controller.

    Under a known controller that is the commanded torque, even if torque was measured: a sensor behind the gear does
    not see the friction in it. None if no drive torque is known, or if every episode is too short.
    """
    rec = without_runaway(rec, nominal_robot(rec), LEAST)
    command = sent(rec, robot_of(rec))
    if command is None and (rec.tau is None or rec.torque_sensor == "none"):
        return None
    tau = rec.tau if command is None else command
    assert tau is not None
    sensor = rec.torque_sensor if command is None else "motor"
    out = replace(rec, control=Control("unknown", rec.rate_hz), torque_sensor=sensor)
    if not long_runs(out):
        return None  # too short: filter transients cover all of it
    return replace(out, tau=smooth(rec.time, tau, MOTION_HZ, rec.episode)[0])


@dataclass(frozen=True)
class Motion:
    """The measured motion of one item, with m samples: what `Effect.regressor` may use.

    Attributes:
        sent: (m, nj) N m, the drive torque.
        rate: gives the low-passed time derivative of values (m, k).
        moved: gives the change of the links' torque (m, nj) N m if all angles are shifted by (m, nj) rad.
    """

    sent: np.ndarray
    rate: Callable[[np.ndarray], np.ndarray]
    moved: Callable[[np.ndarray], np.ndarray]


class Drives:
    """Recordings in torque space: the drive torque of each joint, and the torque that worlds require.

    Its truth value is False if no recording has a known drive torque; the arrays below are then missing.

    Args:
        recordings: of one arm; those without a known drive torque are left out.

    Attributes:
        recordings: those with a known drive torque.
        evidence: compares them by inverse dynamics; None if there are none.
        items: items of the evidence, whose samples stand end to end in the arrays below, n in all.
        which: index in the evidence of each of the items (`each` keeps one of them).
        torque: (n, nj) N m, drive torque, low-passed twice, as the required torque is.
        dq: (n, nj) rad/s, low-passed.
        valid: (n, nj) bool, samples that may be compared.
        measured: whether all torques were measured by a sensor, not computed from a controller.
    """

    def __init__(self, recordings: Sequence[Recording]):
        known = {i: d for i, d in enumerate(map(with_drive_torque, recordings)) if d is not None}
        self.recordings = [recordings[i] for i in known]
        self.evidence = TorqueEvidence([*known.values()], noise=np.ones(len(recordings[0].joints))) if known else None
        self.items = [] if self.evidence is None else self.evidence.items
        self.which = [*range(len(self.items))]
        self.measured = all(r.control.mode in ("unknown", "servo") for r in self.recordings)
        if self.items:
            # the required torque is computed from low-passed motion and filtered again, so this is filtered twice too
            twice = [smooth(i.segment.time, np.nan_to_num(i.measured), MOTION_HZ)[0] for i in self.items]
            self.torque = np.concatenate(twice)
            self.dq = np.concatenate([i.segment.dq for i in self.items])
            self.valid = np.concatenate([i.valid for i in self.items])

    def each(self) -> list[Drives]:
        """Return each item as Drives of its own."""
        ends = np.cumsum([len(i.segment.time) for i in self.items])[:-1]
        out = []
        for k, rows in enumerate(np.split(np.arange(len(self.torque)), ends)):
            one = copy(self)
            one.items, one.which = [self.items[k]], [self.which[k]]
            one.torque, one.dq, one.valid = self.torque[rows], self.dq[rows], self.valid[rows]
            out.append(one)
        return out

    def __bool__(self) -> bool:
        return bool(self.items)

    def needed(self, worlds: Sequence[World]) -> np.ndarray:
        """Return the drive torque (nworld, n, nj) N m that each world requires along the motions, low-passed."""
        parts = []
        for i, item in zip(self.which, self.items, strict=True):
            low = np.concatenate([self._needed(i, world) for world in worlds], axis=1)
            low = smooth(item.segment.time, low, MOTION_HZ)[0]
            parts.append(np.stack(np.split(low, len(worlds), axis=1)))
        return np.concatenate(parts, axis=1)

    def _needed(self, i: int, world: World) -> np.ndarray:
        """Return the torque that a world requires for item `i` of the evidence, (m, nj) N m, not low-passed.

        Effects that inverse dynamics does not show (`Effect.regressor`) add their torque to first order.
        """
        assert self.evidence is not None
        plain = World(effects=tuple(e for e in world.effects if not effect(e.effect).overrides("regressor")))
        out = self.evidence.torque_of(i, plain)
        others = [a for a in activate(self.evidence.items[i].robot, [world]) if a.effect.overrides("regressor")]
        if others:
            motion = self._motion(i, plain)
            out = out + sum(a.effect.regressor(motion, a.p) for a in others)
        return out

    def _motion(self, i: int, world: World) -> Motion:
        """Return the motion of item `i` of the evidence; `world` states the masses of the links."""
        assert self.evidence is not None
        item = self.evidence.items[i]
        seg = item.segment
        ddq = seg.cache["ddq"]

        def derivatives(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return smooth(seg.time, values, MOTION_HZ)[1:]

        def links(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
            mass, bias = rigid_body(item.robot, world, q, dq)
            return np.einsum("nij,nj->ni", mass, ddq) + bias

        def moved(shift: np.ndarray) -> np.ndarray:
            rate, acc = derivatives(shift)
            return links(seg.q + shift, seg.dq + rate, ddq + acc) - links(seg.q, seg.dq, ddq)

        return Motion(np.nan_to_num(item.measured), lambda values: derivatives(values)[0], moved)


def noise(recordings: Sequence[Recording], world: World, seed: int = 0) -> np.ndarray:
    """Return the RMS (nj,) N m that noise alone makes in drive minus required torque.

    Nothing is simulated: noise of the stated size is added once more to the measured q and tau, and the difference is
    what changes.
    """
    rng = np.random.default_rng(seed)
    again = []
    for rec in recordings:
        sigma = noise_of(rec)
        noisier = {"q": rec.q + sigma["q"] * rng.standard_normal(rec.q.shape)}
        if rec.tau is not None and "tau" in sigma:
            noisier["tau"] = rec.tau + sigma["tau"] * rng.standard_normal(rec.q.shape)
        again.append(replace(rec, **noisier))
    first, second = Drives(recordings), Drives(again)
    gap = (second.torque - second.needed([world])[0]) - (first.torque - first.needed([world])[0])
    both = first.valid & second.valid
    return np.sqrt(np.where(both, gap**2, 0.0).sum(axis=0) / np.maximum(both.sum(axis=0), 1))
