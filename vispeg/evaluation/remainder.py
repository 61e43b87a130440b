"""Play back the torque that no named cause explains: resampled in blocks, it disturbs the arm of the identified world.

For each recording, the torque that the drives deliver and the joint torque of the measured contact wrench are
known. Inverse dynamics in the identified world give the torque that the motion needed. What it needed beyond what is
known is the missing torque: applied to the links of the identified world, it makes them move as measured, in free air
and in contact. Blocks of it, of all joints at once to keep their correlation, are drawn with replacement and joined:
the moving-block bootstrap (H. R. Kunsch, Annals of Statistics 17 (1989) 1217). A block is twice the integrated
autocorrelation time long, a lag beyond which the correlation is small, and at least 0.1 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.evaluation.schema.explain import Regime, RemainderSize
from vispeg.identify.inverse import ENDS, MOTION_HZ, TorqueEvidence
from vispeg.identify.nominal import robot_of
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.recording import Recording
from vispeg.sim.compiled import nominal_of
from vispeg.sim.controller import Controller
from vispeg.sim.physics import EffectLoop
from vispeg.sim.placement import activate
from vispeg.sim.segments.rows import Rows
from vispeg.sim.segments.segment import segments
from vispeg.sim.touch import touch
from vispeg.worlds.world import World

SHORTEST = 0.1  # s, shortest block: correlation in less time is due to the filter of the motion, not to a disturbance
PERIOD = 0.02  # s, between rows of missing torque, which is below 8 Hz
BLOCKS = 2  # recordings shorter than this many blocks are resampled only if none is longer
CONTROLLED = ("osc", "position", "torque")  # control modes with a known commanded torque


@dataclass(frozen=True, eq=False)
class Missing:
    """The missing torque of one recording.

    Attributes:
        name: name of the recording.
        time: (m,) s, evenly spaced.
        torque: (m, nj) N m, torque on the links that makes the identified world's arm move as measured, below 8 Hz.
        touching: (m,) bool, whether the arm is in contact.
    """

    name: str
    time: np.ndarray
    torque: np.ndarray
    touching: np.ndarray


def missing_of(rec: Recording, world: World) -> Missing | None:
    """Return the missing torque of a world along a recording.

    None if the recording is too short, has gaps or several episodes, or was not sampled at each control tick.

    Raises:
        UserError: the recording's controller is not known.
    """
    if rec.control.mode not in CONTROLLED:
        expected = f"a known controller: {', '.join(CONTROLLED)}"
        raise UserError("the commanded torque is not known", file=rec.path, expected=expected, got=rec.control.mode)
    robot = robot_of(rec)
    pieces = segments(rec)
    if len(pieces) != 1 or len(pieces[0].q) != len(rec.time) or rec.time[-1] - rec.time[0] < 2 * ENDS + SHORTEST:
        return None
    tau = EffectLoop(activate(robot, [world])).delivered(_commanded(rec))
    # effects with the hook `inverse` are those of the drives: they are in `tau` already
    links = world.only(lambda e: not effect(e.effect).overrides("inverse"))
    felt = touch(rec, robot)
    touching = np.zeros(len(rec.time), bool)
    if felt is not None:
        jac = nominal_of(robot, len(rec.time)).operational(np.nan_to_num(rec.q))[1]
        tau = tau + np.einsum("nij,ni->nj", jac, np.nan_to_num(felt.contact))
        touching = felt.touching
    smoothed = smooth(rec.time, tau, MOTION_HZ)[0]  # filtered as the motion is
    evidence = TorqueEvidence([replace(rec, tau=smoothed, torque_sensor="motor", ft=None, wrench=None)])
    item, (least, most) = evidence.items[0], evidence.torque_range(0, links)
    valid = item.valid.all(axis=1)
    # needed minus known (`item.measured`); 0 where dry friction lets a joint at rest hold the known torque
    missing = (np.clip(item.measured, least, most) - item.measured)[valid]
    return Missing(rec.name, item.segment.time[valid], missing, touching[item.segment.rows][valid])


def _commanded(rec: Recording) -> np.ndarray:
    """Return the torque (n, nj) N m that the controller commanded at each sample.

    It is the mean of the commands of the control periods before and after the sample.
    """
    robot, (segment,) = robot_of(rec), segments(rec)
    rows = Rows([segment], 1)
    # along=False: gravity at the measured angles, not linearised
    law = Controller(robot, rows, nominal_of(robot, 1), rows.by_tick(lambda s: s.q), along=False)
    dq = segment.dq if rec.dq is None else np.nan_to_num(rec.dq)
    asked = [law.command(k, segment.q_raw[[k]], dq[[k]])[0] for k in range(segment.ticks)]
    tau = np.array(asked)
    return 0.5 * (tau + np.concatenate([tau[:1], tau[:-1]]))


def time_constant(pieces: Sequence[np.ndarray], period: float) -> float:
    """Return the integrated autocorrelation time of series (m, nj), s.

    The autocovariance, about each joint's mean over all pieces, is summed over joints and pieces, and the
    autocorrelation added up to its first zero.
    """
    most, mean = min(map(len, pieces)), np.concatenate(pieces).mean(axis=0)
    total = np.zeros(most)
    for piece in pieces:
        size = 2 ** int(np.ceil(np.log2(2 * len(piece))))
        spectrum = np.abs(np.fft.rfft(piece - mean, size, axis=0)) ** 2
        total += np.fft.irfft(spectrum, size, axis=0)[:most].sum(axis=1) / (1 - np.arange(most) / len(piece))
    if total[0] <= 0:
        return 0.0
    r = total / total[0]
    ends = np.flatnonzero(r <= 0)
    return float(period * (1 + 2 * r[1 : ends[0] if len(ends) else most].sum())) / 2


@dataclass(frozen=True, eq=False)
class Remainder:
    """Missing torques to resample.

    Attributes:
        joints: names of the joints.
        pieces: missing torque of each recording, (m, nj) N m, one row every `period`.
        period: time between rows, s.
        block: length of a block, s.
        tick: control period of the torques to draw, s.
        names: names of the recordings.
        touching: (m,) bool for each piece, whether the arm is in contact.
    """

    joints: tuple[str, ...]
    pieces: tuple[np.ndarray, ...]
    period: float
    block: float
    tick: float
    names: tuple[str, ...]
    touching: tuple[np.ndarray, ...]

    @classmethod
    def of(
        cls, missing: Sequence[Missing], floor: Sequence[Missing], joints: tuple[str, ...], tick: float
    ) -> Remainder | None:
        """Make a remainder of recordings' missing torques, scaled down by the method's own error.

        Args:
            missing: missing torques of the held-out recordings.
            floor: missing torques of simulated recordings in their own world, which are errors of the method. Their
                variance is subtracted from each joint's; empty to subtract nothing.
            joints: names of the joints.
            tick: control period of the torques to draw, s.

        Returns:
            The remainder; None if `missing` is empty.
        """
        if not missing:
            return None
        even = [(m.name, *_even(m, PERIOD)) for m in missing]
        block = max(SHORTEST, 2 * time_constant([rows for _, rows, _ in even], PERIOD))
        kept = [(name, rows, touching) for name, rows, touching in even if len(rows) * PERIOD >= BLOCKS * block] or even
        square = np.mean(np.concatenate([rows for _, rows, _ in kept]) ** 2, axis=0)
        error = np.mean(np.concatenate([m.torque for m in floor]) ** 2, axis=0) if floor else np.zeros(len(joints))
        scale = np.sqrt(np.maximum(1 - error / np.maximum(square, 1e-12), 0.0))
        pieces = tuple(rows * scale for _, rows, _ in kept)
        names, touching = tuple(name for name, _, _ in kept), tuple(touching for _, _, touching in kept)
        return cls(joints, pieces, PERIOD, block, tick, names, touching)

    @property
    def rms(self) -> np.ndarray:
        """RMS of the missing torque in each joint, (nj,) N m."""
        return np.sqrt(np.mean(np.concatenate(self.pieces) ** 2, axis=0))

    def draw(self, seed: int, ticks: int) -> np.ndarray:
        """Return torques (ticks, nj) N m for the episode with this seed, one row per control period."""
        rng = stream(seed, "remainder")
        length = max(1, round(self.block / self.period))
        needed = int(np.ceil(ticks * self.tick / self.period)) + 2
        weight = np.array([max(1, len(p) - length + 1) for p in self.pieces], float)  # number of blocks in each
        blocks: list[np.ndarray] = []
        while sum(map(len, blocks)) < needed:
            piece = self.pieces[int(rng.choice(len(self.pieces), p=weight / weight.sum()))]
            start = int(rng.integers(max(1, len(piece) - length + 1)))
            blocks.append(piece[start : start + length])
        rows = np.concatenate(blocks)[:needed]
        at = np.arange(ticks) * self.tick / self.period
        return np.stack([np.interp(at, np.arange(needed), column) for column in rows.T], axis=1)

    def sizes(self) -> list[RemainderSize]:
        """Return the missing torque's RMS in each joint, N m, the largest first."""
        order = np.argsort(-self.rms)
        return [{"joint": self.joints[j], "rms": float(self.rms[j]), "unit": "N m"} for j in order]

    def regimes(self) -> dict[str, Regime]:
        """Return for free air and contact the share of the missing torque's power, and the number of recordings.

        A recording counts if at least half a block of it is in that regime.
        """
        power = np.concatenate([(p**2).sum(axis=1) for p in self.pieces])
        enough = 0.5 * self.block / self.period
        out: dict[str, Regime] = {}
        for name, inside in (("free air", False), ("contact", True)):
            masks = [on == inside for on in self.touching]
            part = float(power[np.concatenate(masks)].sum() / max(power.sum(), 1e-12))
            out[name] = {"share": part, "recordings": sum(bool(mask.sum() >= enough) for mask in masks)}
        return out


def _even(m: Missing, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a recording's missing torque (k, nj) N m, and whether the arm is in contact (k,), every `period` s."""
    at = np.arange(m.time[0], m.time[-1] + 1e-9, period)
    rows = np.stack([np.interp(at, m.time, column) for column in m.torque.T], axis=1)
    after = np.clip(np.searchsorted(m.time, at - 1e-9), 0, len(m.time) - 1)
    return rows, m.touching[after]
