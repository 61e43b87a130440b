"""Compare torques: inverse dynamics of the measured motion against the measured torque.

This is the only comparison possible if the controller is unknown. It has the interface of `Evidence`, so everything
that judges worlds by rollouts can also judge them by torques. Delays, gear play and encoder errors leave no trace in
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import mujoco
import numpy as np

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.core.rules import RULES
from vispeg.identify.channels import Channel, Item
from vispeg.identify.contact import ALWAYS, Contact, contact_of
from vispeg.identify.evidence import Evidence
from vispeg.identify.nominal import robot_of
from vispeg.recordings.checks import missing
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.noise import highpass_sigma
from vispeg.recordings.recording import Control, Recording
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import compiled
from vispeg.sim.inverse_dynamics import InverseDynamics, uncounted
from vispeg.sim.physics import EffectLoop
from vispeg.sim.placement import activate
from vispeg.sim.segments.segment import Segment
from vispeg.sim.state import DriveState, Fields, RowFields
from vispeg.worlds.world import World

MOTION_HZ = 8.0  # bandwidth within which the motion's acceleration is reliable
SAMPLES_HZ = 50.0  # six times that bandwidth: more samples would add no information
REMEMBERED = 128e6  # bytes of cached torques along motions: a minute of 7 joints in 760 worlds
ENDS = 0.5  # s at both ends of an episode that are not compared: filter transients
STICK = 0.01  # rad/s over which dry friction changes sign: velocity noise rules out a sharper edge
STANDS = 3 * STICK  # rad/s, below which a joint may be at rest
LATEST = 2.0  # s by which two runs of one motion may start at different times
# Fields whose effects change the links' inertia or gravity
RIGID = frozenset({"body_mass", "body_ipos", "body_inertia", "body_iquat", "opt.gravity"})
CAVEATS = (
    "the controller is unknown: worlds were compared by inverse dynamics, in which delays, gear play and encoder "
    "errors leave no trace",
    "presliding cannot be told from Coulomb friction where velocities were low-passed",
)
# Sensors of real arms feel part of it: on held-out runs, friction of every joint lowers the residual of least squares
# from .42 to .30 N m for a Franka Panda and from 1.43 to .81 N m for a KUKA LWR4+ (scripts/bench/real_arms.py)
BEHIND = (
    "the torque sensor is behind the gear: friction and rotor inertia are found only as far as it feels them; what a "
    "drive loses before it leaves no trace"
)


class TorqueEvidence(Evidence):
    """Recordings compared by inverse dynamics; the channels are joint torques in N m.

    Args:
        recordings: with a measured torque.
        noise: (nj,) N m of each joint's torque; by default from two runs of one motion, as stated, or estimated.
    """

    def __init__(self, recordings: Sequence[Recording], noise: np.ndarray | None = None):
        self.recordings, self.nthread = list(recordings), 1
        self.notes, self.converted = list(CAVEATS), []
        self.notes += [BEHIND] if any(rec.torque_sensor == "joint" for rec in recordings) else []
        self._recent = []
        noise, self.floor_from = _noise(self.recordings) if noise is None else (noise, "given")
        # One weight for all joints, so that an error of 1 N m counts the same in each: the rigid model's error exceeds
        # sensor noise by far. On a held-out recording of a KUKA LWR4+ a diagnosis with it ends at .181 N m; with each
        # joint's own noise as its sigma at .249, with 5 % of the joint's torque added to that at .358
        # (scripts/bench/real_arms.py).
        sigma, self._floors = np.full_like(noise, np.sqrt(np.mean(noise**2))), noise
        lacking = dict.fromkeys(line for rec in recordings for line in uncounted(compiled(robot_of(rec))))
        self.notes += [f"inverse dynamics does not count: {', '.join(lacking)}"] if lacking else []
        self.notes += [rec.chosen.said(rec.name) for rec in recordings if rec.chosen]
        self.notes += [line for rec in recordings for line in missing.said(rec)]
        touched = [(rec, contact_of(rec, robot_of(rec))) for rec in recordings]
        self.notes += [contact.said(rec.name) for rec, contact in touched if contact is not None]
        self.items = [item for rec, contact in touched for item in _items(rec, sigma, contact)]
        self._ddq = [i.segment.cache["ddq"] for i in self.items]
        self._rigid: dict[tuple[int, str], np.ndarray] = {}
        worlds = max(1, int(REMEMBERED // max(1, sum(ddq.nbytes for ddq in self._ddq))))
        self._most = worlds * len(self.items)

    @property
    def least_gain(self) -> float:
        """Share of the held-out squared error that a step must remove."""
        return RULES.gain_torque

    @property
    def floors(self) -> np.ndarray:
        """Noise of each joint's torque, (nj,) N m, regardless of its weight in the comparison."""
        return self._floors

    def _simulated(self, worlds: Sequence[World]) -> list[np.ndarray]:
        """Return for each item the sensor torques (nworld, m, nj) that the worlds predict."""
        return [np.stack([self.torque_of(i, world) for world in worlds]) for i in range(len(self.items))]

    def torque_of(self, i: int, world: World) -> np.ndarray:
        """Return the sensor torque (m, nj) of one world along one measured motion."""
        item, seg = self.items[i], self.items[i].segment
        needed, dry, beside, loop = self._parts(i, world)
        needed = needed + dry * np.tanh(seg.dq / STICK)
        needed = needed if beside is None else needed - beside
        return loop.inverse(needed, item.recording.torque_sensor)

    def torque_range(self, i: int, world: World) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and greatest sensor torque (m, nj) of a world.

        They differ at speeds under `STANDS`, since a joint at rest holds any torque up to its dry friction.
        """
        item, seg = self.items[i], self.items[i].segment
        needed, dry, beside, loop = self._parts(i, world)
        needed = needed if beside is None else needed - beside
        still = np.where(np.abs(seg.dq) < STANDS, 1.0, 0.0)
        ends = [dry * ((1 - still) * np.tanh(seg.dq / STICK) + side * still) for side in (-1.0, 1.0)]
        low, high = (loop.inverse(needed + end, item.recording.torque_sensor) for end in ends)
        return low, high

    def _parts(self, i: int, world: World) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, EffectLoop]:
        """Return what makes up the torque of a world along the motion of item `i`, (m, nj) N m each.

        Returns:
            torque that the motion needs without dry friction, level of dry friction, torque that effects exert on the
            joints in addition to the drive (None if no effect does), and the effects themselves.
        """
        item, seg, ddq = self.items[i], self.items[i].segment, self._ddq[i]
        robot, active = item.robot, activate(item.robot, [world])
        fields = Fields(RowFields(compiled(robot), 1), robot)
        for a in active:
            a.effect.write(fields, a.p)
        dof, joint, spring = fields.dofs, fields.joints, fields.qposes
        # the links' torque contains the model's own rotor inertia; that of the world is added below
        load = self._links(i, world) - compiled(robot).dof_armature[dof] * ddq
        # MuJoCo's springs and dampers: polynomials with a linear, a square and a cubic term
        turn, (square, cube) = seg.q - fields["qpos_spring"][0, spring], compiled(robot).jnt_stiffnesspoly[joint].T
        load += turn * (fields["jnt_stiffness"][0, joint] + turn * (square + turn * cube))
        speed, (square, cube) = np.abs(seg.dq), compiled(robot).dof_dampingpoly[dof].T
        drag = seg.dq * (fields["dof_damping"][0, dof] + speed * (square + speed * cube))
        needed = load + fields["dof_armature"][0, dof] * ddq + drag
        clock = (seg.begun + seg.time)[:, None]
        # a measured motion takes no step: what an effect adds for the sake of its stability vanishes
        x = DriveState(0.0, 1e-3, seg.q, seg.dq, ddq, load, np.ones_like(needed), clock)
        dry = np.broadcast_to(fields["dof_frictionloss"][0, dof], needed.shape).copy()
        loop = EffectLoop(active)
        return needed, loop.friction(x, dry), loop.along(x, seg.cache["path"], seg.cache["at"]), loop

    def _links(self, i: int, world: World) -> np.ndarray:
        """Return the torque (m, nj) N m that a world's rigid links need along the motion of item `i`; cached."""
        rigid = World(effects=tuple(e for e in world.effects if effect(e.effect).writes & RIGID))
        key = (i, repr([(e.label, e.params) for e in rigid.effects]))
        found = self._rigid.pop(key, None)
        if found is None:
            seg = self.items[i].segment
            mass, bias = rigid_body(self.items[i].robot, rigid, seg.q, seg.dq)
            found = np.einsum("nij,nj->ni", mass, self._ddq[i]) + bias
        self._rigid[key] = found  # the latest; the oldest are dropped first
        if len(self._rigid) > self._most:
            del self._rigid[next(iter(self._rigid))]
        return found


def rigid_body(robot: RobotModel, world: World, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return inertia (n, nj, nj) kg m2 and bias torque (n, nj) N m of a world's links at n states, rad and rad/s.

    Bias is gravity, centrifugal and Coriolis torque, less the torque of tendons and the medium; springs and dampers of
    joints, which effects change, are not in it. Of the world only effects that change masses or gravity matter.
    """
    model = copy(compiled(robot))
    rigid = World(effects=tuple(e for e in world.effects if effect(e.effect).writes & RIGID))
    fields = Fields(RowFields(compiled(robot), 1), robot)
    for a in activate(robot, [rigid]):
        a.effect.write(fields, a.p)
    for name in RIGID & fields.touched:
        owner = model.opt if name.startswith("opt.") else model
        getattr(owner, name.removeprefix("opt."))[:] = fields[name][0]
    mujoco.mj_setConst(model, mujoco.MjData(model))  # updates `body_sameframe`: else some changed frames are ignored
    for name in ("jnt_stiffness", "jnt_stiffnesspoly", "dof_damping", "dof_dampingpoly"):
        getattr(model, name)[:] = 0.0
    return InverseDynamics(model, robot.joints).terms(q, dq)


def evidence_for(recordings: Sequence[Recording], nthread: int = 1, *, beside: Sequence[Recording] = ()) -> Evidence:
    """Return rollout evidence if every controller is known, otherwise inverse dynamics.

    Args:
        recordings: of one robot and the same joints.
        nthread: as in `Evidence`; inverse dynamics does not need it.
        beside: recordings of another evidence that is compared in the same way, such as the held-out ones.

    Raises:
        UserError: recordings of different robots or joints, or that cannot be compared.
    """
    if nthread < 1:
        raise UserError("must be at least 1", key="threads", got=nthread)
    compared = (*recordings, *beside)
    for rec in compared:
        if rec.robot != compared[0].robot:
            what = "recordings of different robots"
            raise UserError(what, file=rec.path, key="robot", expected=compared[0].robot, got=rec.robot)
        if rec.joints != compared[0].joints:
            expected, got = (", ".join(r.joints) for r in (compared[0], rec))
            raise UserError("recordings of different joints", file=rec.path, key="joints", expected=expected, got=got)
    if any(rec.control.mode == "unknown" for rec in compared):
        return TorqueEvidence(recordings)
    return Evidence(recordings, nthread=nthread)


def _items(rec: Recording, sigma: np.ndarray, contact: Contact | None) -> list[Item]:
    """Return one item per episode, differentiated separately; an episode is cut at long gaps in its angles.

    Raises:
        UserError: no torque with a stated sensor placement, no episode longer than the filter's transients, or no
            sample in free air with angles and a torque.
    """
    if rec.tau is None or rec.torque_sensor == "none":
        header = rec.path / "recording.yaml"
        why, key = "no torque was measured", "tau.*"
        if rec.torque_sensor == "none":
            why, key = "`torque_sensor` is none, so that no torque is used", "torque_sensor"
        expected = "joint or motor, with tau columns, or a controller"
        whose = "the controller" if rec.control.mode == "unknown" else "another recording's controller"
        raise UserError(f"{whose} is unknown and {why}", file=header, key=key, expected=expected)
    free = np.ones(len(rec.time), bool) if contact is None else contact.free
    free = free if rec.compared is None else free & rec.compared
    long = long_runs(rec)
    if not long:
        raise UserError(f"too short to compare: every episode lasts under {2 * ENDS:g} s", file=rec.path)
    items = [_item(rec, rec.tau, run, sigma, free) for run in long]
    items = [item for item in items if item.valid.any()]
    if not items and contact is not None:
        raise UserError(ALWAYS, file=rec.path, expected="a second or more in free air")
    if not items:
        raise UserError("no torque is read where the joints' motion is known", file=rec.path, key="tau.*")
    return items


def long_runs(rec: Recording) -> list[np.ndarray]:
    """Return the rows of each episode, cut at long gaps in its angles, that has samples to compare between its ends."""
    number = np.zeros(len(rec.time), int) if rec.episode is None else rec.episode
    runs = [run for n in np.unique(number) for run in missing.stretches(rec, np.flatnonzero(number == n))]
    return [run for run in runs if _inside((rec.time[run] - rec.time[run[0]])[_thin(rec)]).any()]


def _thin(rec: Recording) -> slice:
    """Return which of an episode's samples are compared, about `SAMPLES_HZ`."""
    return slice(None, None, max(1, round(rec.rate_hz / SAMPLES_HZ)))


def _inside(time: np.ndarray) -> np.ndarray:
    """Return which samples, (n,) s after an episode's start, are not at its ends, (n,) bool."""
    return (time >= ENDS) & (time <= time[-1] - ENDS)


def _item(rec: Recording, tau: np.ndarray, rows: np.ndarray, sigma: np.ndarray, free: np.ndarray) -> Item:
    """Return the item of some consecutive rows, thinned to `SAMPLES_HZ`; `free` (n,) says which may be compared.

    `tau` (n, nj) is the measured torque, `sigma` (nj,) its noise.
    """
    robot, time = robot_of(rec), rec.time[rows] - rec.time[rows[0]]
    thin = _thin(rec)
    path, dq, ddq = smooth(time, rec.q[rows], MOTION_HZ)
    read = np.isfinite(ddq.sum(axis=1))
    path, dq, ddq = (np.nan_to_num(v) for v in (path, dq, ddq))  # missing readings are not compared
    at = np.arange(len(time))[thin]
    q, dq, ddq = path[thin], dq[thin], ddq[thin]
    time, tau, raw = time[thin], tau[rows][thin], rec.q[rows][thin]
    control = Control("unknown", rec.rate_hz)
    raw = np.where(np.isfinite(raw), raw, q)
    segment = Segment(control, 1.0 / rec.rate_hz, {}, q, dq, raw, time, rows[thin], float(rec.elapsed[rows[0]]))
    segment.cache.update(ddq=ddq, path=path, at=at)
    valid = np.isfinite(tau) & (_inside(time) & free[rows][thin] & read[thin])[:, None]
    return Item(rec, segment, robot, (Channel("needed", tau, sigma, valid),))


def _noise(recordings: Sequence[Recording]) -> tuple[np.ndarray, str]:
    """Return the noise (nj,) N m of torques and its source.

    The source is two runs of one motion; without them the noise that the first recording states; without that an
    estimate from its high frequencies, at least a share of its spread.
    """
    for i, a in enumerate(recordings):
        for b in recordings[i + 1 :]:
            gap = _repeat_gap(a, b)
            if gap is not None:
                return gap, "repeats"
    first = recordings[0]
    if "tau" in first.noise:
        return np.full(first.q.shape[1], float(first.noise["tau"])), "stated noise"
    tau = first.tau if first.tau is not None else np.zeros_like(first.q)
    read = np.isfinite(tau).any(axis=0)
    sigma = np.full(tau.shape[1], np.nan)
    sigma[read] = np.maximum(highpass_sigma(tau[:, read]), RULES.torque_repeats * np.nanstd(tau[:, read], axis=0))
    return np.maximum(_filled(sigma), 1e-3), "estimated"


def _filled(sigma: np.ndarray) -> np.ndarray:
    """Return noise (nj,); joints without readings (NaN), which are not compared, get the RMS of the others."""
    read = np.isfinite(sigma)
    return np.where(read, sigma, np.sqrt(np.mean(sigma[read] ** 2)) if read.any() else 0.0)


def _repeat_gap(a: Recording, b: Recording) -> np.ndarray | None:
    """Return the torque noise (nj,) N m from two runs of one motion, aligned in time; None if they cannot be aligned.

    Starts may differ by up to `LATEST` seconds.
    """
    if a.tau is None or b.tau is None or a.q.shape[1] != b.q.shape[1] or a.chosen or b.chosen:
        return None
    margin = int(LATEST * a.rate_hz)  # samples left out at both ends of `a`
    n = min(len(a.time), len(b.time)) - 2 * margin
    if n < a.rate_hz:  # less than a second
        return None
    core = a.q[margin : margin + n]

    def gap(start: int) -> float:
        return float(np.nanmax(np.nanstd(core - b.q[start : start + n], axis=0)))

    coarse = min(range(0, 2 * margin + 1, max(1, margin // 100)), key=gap)
    best = min(range(max(0, coarse - margin // 100), min(2 * margin, coarse + margin // 100) + 1), key=gap)
    if gap(best) > RULES.torque_repeats * np.nanmax(np.nanstd(core, axis=0)):
        return None
    difference = a.tau[margin : margin + n] - b.tau[best : best + n]
    read = np.isfinite(difference).any(axis=0)
    sigma = np.nanstd(np.where(read, difference, 0.0), axis=0) / np.sqrt(2.0)
    return _filled(np.where(read, sigma, np.nan)) if read.any() else None
