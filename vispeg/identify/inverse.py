"""Evidence in torque space: inverse dynamics of measured motion against measured torque.

All there is where the controller is unknown. It shares the face of `Evidence`, so that everything that judges worlds by
rollouts can judge them by torques; effects of timing, gear play and readings leave no trace in it.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco import batch as mjb

from vispeg.core.effect import Effect
from vispeg.core.errors import UserError
from vispeg.core.world import World
from vispeg.identify.evidence import Evidence, Item, robot_of
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.noise import highpass_sigma
from vispeg.recordings.recording import Control, Recording
from vispeg.sim.nominal import Nominal, dense
from vispeg.sim.placement import activate
from vispeg.sim.rollout import compiled
from vispeg.sim.segment import Segment
from vispeg.sim.state import DriveState, Fields

MOTION_HZ = 8.0  # bandwidth of the motion whose acceleration is believed
STICK = 0.01  # rad/s over which dry friction changes sign: velocity noise makes a sharper edge meaningless
CAVEATS = (
    "the controller is unknown: worlds were compared by inverse dynamics, in which delays, gear play and encoder errors "
    "leave no trace",
    "presliding cannot be told from Coulomb friction where velocities were low-passed",
)


class TorqueEvidence(Evidence):
    """Recordings compared by inverse dynamics; the channels are joint torques in N m."""

    def __init__(self, recordings: Sequence[Recording]):
        self.recordings = list(recordings)
        self.unit, self.notes, self.rollouts = "N m", list(CAVEATS), 0.0
        self._recent = []
        sigma = _noise(self.recordings)
        self.items = [_item(rec, sigma) for rec in recordings]
        self._ddq = [smooth(i.segment.time, i.segment.q_raw, MOTION_HZ)[2] for i in self.items]

    def _simulated(self, worlds: Sequence[World]) -> list[np.ndarray]:
        """Per item, the torques (nworld, m, nj) that the worlds say the sensor would read."""
        return [
            np.stack([_needed(item, ddq, world) for world in worlds])
            for item, ddq in zip(self.items, self._ddq, strict=True)
        ]


def evidence_for(world: World, recordings: Sequence[Recording], nthread: int = 1, h_max: float = 2e-3) -> Evidence:
    """Rollouts where every controller is known, inverse dynamics where one is not."""
    for rec in recordings:
        if rec.robot != recordings[0].robot:
            raise UserError("recordings of different robots", file=rec.path, key="robot", expected=recordings[0].robot, got=rec.robot)
    if any(rec.control.mode == "unknown" for rec in recordings):
        return TorqueEvidence(recordings)
    return Evidence(recordings, h_max=h_max, nthread=nthread)


def measurable(kind: Effect) -> bool:
    """Whether an effect leaves a trace in inverse dynamics."""
    return any(kind.overrides(hook) for hook in ("write", "friction", "torque", "inverse"))


def _needed(item: Item, ddq: np.ndarray, world: World) -> np.ndarray:
    """Sensor torque (m, nj) of one world along the measured motion: each sample is a row of one batch."""
    robot, seg = item.robot, item.segment
    model, m = compiled(robot), len(seg.time)
    active = activate(robot, [world] * m)
    batch = mjb.Batch(model, m, nthread=1)
    fields = Fields(batch, robot)
    for a in active:
        a.effect.write(fields, a.p)
    nominal = Nominal(model, robot.joints, robot.flange, 1, 1)
    batch.bind("qpos")[:, nominal.qadr] = seg.q
    batch.bind("qvel")[:, nominal.vadr] = seg.dq
    bias, mass = batch.bind("qfrc_bias"), batch.bind("M")
    spring, damper = batch.bind("qfrc_spring"), batch.bind("qfrc_damper")
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
    v = nominal.vadr
    full = np.zeros((m, model.nv))
    full[:, v] = ddq
    needed = (np.einsum("nij,nj->ni", dense(model, mass), full) + bias - spring - damper)[:, v]
    x = DriveState(1e-3, 1e-3, seg.q, seg.dq, ddq, needed.copy(), np.ones_like(needed))
    level = batch.expanded("dof_frictionloss")
    dry = level[:, v].copy() if level is not None else np.zeros_like(needed)
    for a in active:
        if a.effect.overrides("friction"):
            dry += a.effect.friction(None, x, a.p)
    needed = needed + dry * np.tanh(seg.dq / STICK)
    for a in active:
        if a.effect.overrides("torque"):
            needed = needed - _along(a, x, seg)
    for a in active:
        if a.effect.overrides("inverse"):
            needed = a.effect.inverse(needed, item.recording.torque_sensor, a.p)
    return needed


def _along(active, x: DriveState, seg: Segment) -> np.ndarray:
    """An effect's own torque along the motion; one with a state is carried through time sample by sample."""
    state = active.effect.start(_row(x, 0), {k: v[:1] for k, v in active.p.items()})
    if state is None:
        return active.effect.torque(None, x, active.p)
    p = {k: v[:1] for k, v in active.p.items()}
    return np.concatenate([active.effect.torque(state, _row(x, i), p) for i in range(len(seg.time))])


def _row(x: DriveState, i: int) -> DriveState:
    one = slice(i, i + 1)
    return DriveState(x.h, x.tick, x.q[one], x.dq[one], x.ddq[one], x.tau[one], np.full_like(x.q[one], 1e9))


def _item(rec: Recording, sigma: np.ndarray) -> Item:
    if rec.tau is None:
        raise UserError("the controller is unknown and no torque was measured", file=rec.path, key="tau.*", expected="torque columns")
    robot = robot_of(rec)
    time = rec.time - rec.time[0]
    q, dq, _ = smooth(time, rec.q, MOTION_HZ)
    control = Control("unknown", rec.rate_hz)
    segment = Segment(control, 1.0 / rec.rate_hz, {}, q, dq, np.where(np.isfinite(rec.q), rec.q, q), time, np.arange(len(time)))
    inside = (time >= 0.5) & (time <= time[-1] - 0.5)  # the ends are where a zero-phase filter guesses
    valid = np.isfinite(rec.tau) & inside[:, None]
    return Item(rec, segment, robot, rec.tau, sigma, valid, "torque")


def _noise(recordings: Sequence[Recording]) -> np.ndarray:
    """(nj,) N m: half the variance between two runs of one trajectory, else as stated, else the high-pass estimate."""
    for i, a in enumerate(recordings):
        for b in recordings[i + 1 :]:
            n = min(len(a.time), len(b.time))
            if a.tau is None or b.tau is None or a.q.shape[1] != b.q.shape[1]:
                continue
            if np.nanmax(np.abs(a.q[:n] - b.q[:n])) < 0.02:
                return np.nanstd(a.tau[:n] - b.tau[:n], axis=0) / np.sqrt(2.0)
    first = recordings[0]
    if "tau" in first.noise:
        return np.full(first.q.shape[1], float(first.noise["tau"]))
    return np.maximum(highpass_sigma(first.tau), 1e-3) if first.tau is not None else np.ones(first.q.shape[1])
