"""What no named cause explains, played back: the arm's missing torque, resampled in blocks, disturbs the found world.

Of each recording the torque is known that its controller asked for and that the measured wrench puts on the joints; the
found world says, by inverse dynamics, what the motion needed. The difference is the missing torque, in free air and in
contact alike. Blocks of it (all joints at once, so that they hang together as they did) are drawn with replacement and
set one behind the other: the moving-block bootstrap (H. R. Kunsch, Annals of Statistics 17 (1989) 1217). A block is
twice the integrated autocorrelation time long, in which nearly all that hangs together lies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.evaluation.schema.explain import Regime, RemainderSize
from vispeg.identify.inverse import ENDS, MOTION_HZ, TorqueEvidence
from vispeg.identify.nominal import robot_of
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.recording import Recording
from vispeg.sim.compiled import nominal_of
from vispeg.sim.controller import Controller
from vispeg.sim.segments.rows import Rows
from vispeg.sim.segments.segment import segments
from vispeg.sim.touch import touch
from vispeg.worlds.world import World

SHORTEST = 0.1  # s, of a block: under it the filter of the motion, and no disturbance, is what hangs together
RUNS_A_PIECE = 2  # blocks that a recording must hold to be resampled
CONTROLLED = ("osc", "position", "torque")  # modes of which the commanded torque is known


@dataclass(frozen=True, eq=False)
class Missing:
    """The missing torque of one recording.

    Attributes:
        name: of the recording.
        time: (m,) s, even.
        torque: (m, nj) N m, what must be added to the found world's arm to move as measured, below 8 Hz.
        touching: (m,) bool.
    """

    name: str
    time: np.ndarray
    torque: np.ndarray
    touching: np.ndarray


def missing_of(rec: Recording, world: World) -> Missing | None:
    """Return the missing torque of a world along a recording; None if the recording is too short.

    Raises:
        UserError: a recording whose controller is not known.
    """
    if rec.control.mode not in CONTROLLED:
        expected = f"a known controller: {', '.join(CONTROLLED)}"
        raise UserError("no torque is known that was commanded", file=rec.path, expected=expected, got=rec.control.mode)
    robot = robot_of(rec)
    pieces = segments(rec)
    if len(pieces) != 1 or len(pieces[0].q) != len(rec.time) or rec.time[-1] - rec.time[0] < 2 * ENDS + SHORTEST:
        return None
    tau = _commanded(rec)
    felt = touch(rec, robot)
    touching = np.zeros(len(rec.time), bool)
    if felt is not None:
        jac = nominal_of(robot, len(rec.time)).operational(np.nan_to_num(rec.q))[1]
        tau = tau + np.einsum("nij,ni->nj", jac, np.nan_to_num(felt.contact))
        touching = felt.touching
    low = smooth(rec.time, tau, MOTION_HZ)[0]  # as the motion is, for the two are compared
    evidence = TorqueEvidence([replace(rec, tau=low, torque_sensor="motor", ft=None, wrench=None)])
    item, (least, most) = evidence.items[0], evidence.torque_range(0, world)
    valid = item.valid.all(axis=1)
    rest = (item.measured - np.clip(item.measured, least, most))[valid]
    return Missing(rec.name, item.segment.time[valid], rest, touching[item.segment.rows][valid])


def _commanded(rec: Recording) -> np.ndarray:
    """Torque (n, nj) N m that the controller asked for at each sample: the mean of before and after it."""
    robot, (segment,) = robot_of(rec), segments(rec)
    rows = Rows([segment], 1)
    law = Controller(robot, rows, nominal_of(robot, 1), rows.by_tick(lambda s: s.q), along=False)
    dq = segment.dq if rec.dq is None else np.nan_to_num(rec.dq)
    asked = [law.command(k, segment.q_raw[[k]], dq[[k]])[0] for k in range(segment.ticks)]
    tau = np.array(asked)
    return 0.5 * (tau + np.concatenate([tau[:1], tau[:-1]]))


def time_constant(pieces: Sequence[np.ndarray], period: float) -> float:
    """Integrated autocorrelation time, s, of series (m, nj) that are pooled, each joint by its power.

    The sum of autocorrelations up to their first zero, from the mean over pieces.
    """
    most = min(map(len, pieces))
    total = np.zeros(most)
    for piece in pieces:
        size = 2 ** int(np.ceil(np.log2(2 * len(piece))))
        spectrum = np.abs(np.fft.rfft(piece, size, axis=0)) ** 2
        total += np.fft.irfft(spectrum, size, axis=0)[:most].sum(axis=1) / (1 - np.arange(most) / len(piece))
    if total[0] <= 0:
        return 0.0
    r = total / total[0]
    ends = np.flatnonzero(r <= 0)
    return float(period * (1 + 2 * r[1 : ends[0] if len(ends) else most].sum())) / 2


@dataclass(frozen=True, eq=False)
class Remainder:
    """Missing torques to be resampled.

    Attributes:
        joints: their names.
        pieces: (m, nj) N m of each recording, every `period` s.
        period: s.
        block: s.
        tick: control period, s, of what is drawn.
        names: of the recordings.
        touching: of each piece (m,) bool.
    """

    joints: tuple[str, ...]
    pieces: tuple[np.ndarray, ...]
    period: float
    block: float
    tick: float
    names: tuple[str, ...] = ()
    touching: tuple[np.ndarray, ...] = ()

    @classmethod
    def of(
        cls, missing: Sequence[Missing], floor: Sequence[Missing], joints: tuple[str, ...], tick: float
    ) -> Remainder | None:
        """Gather what recordings miss, with the variance that the method itself leaves taken off each joint.

        Args:
            missing: of the held-out recordings.
            floor: of simulated ones against their own world; none: nothing is taken off.
            joints: their names.
            tick: control period, s.

        Returns:
            None where no recording is long enough.
        """
        period = 0.02
        whole = [(m, _even(m, period)) for m in missing]
        if not whole:
            return None
        block = max(SHORTEST, 2 * time_constant([rows for _, (rows, _) in whole], period))
        kept = [(m, rows, on) for m, (rows, on) in whole if len(rows) * period >= RUNS_A_PIECE * block]
        kept = kept or [(m, rows, on) for m, (rows, on) in whole]
        square = np.mean(np.concatenate([rows for _, rows, _ in kept]) ** 2, axis=0)
        least = np.mean(np.concatenate([m.torque for m in floor]) ** 2, axis=0) if floor else np.zeros(len(joints))
        share = np.sqrt(np.maximum(1 - least / np.maximum(square, 1e-12), 0.0))
        pieces = tuple(rows * share for _, rows, _ in kept)
        return cls(joints, pieces, period, block, tick, tuple(m.name for m, _, _ in kept), tuple(on for *_, on in kept))

    @property
    def rms(self) -> np.ndarray:
        """(nj,) N m."""
        return np.sqrt(np.mean(np.concatenate(self.pieces) ** 2, axis=0))

    def draw(self, seed: int, ticks: int) -> np.ndarray:
        """Give torques (ticks, nj) N m for an episode, from a stream of its own."""
        rng = stream(seed, "remainder")
        length = max(1, round(self.block / self.period))
        needed = int(np.ceil(ticks * self.tick / self.period)) + 2
        weight = np.array([max(1, len(p) - length + 1) for p in self.pieces], float)  # every block is as likely
        blocks: list[np.ndarray] = []
        while sum(map(len, blocks)) < needed:
            piece = self.pieces[int(rng.choice(len(self.pieces), p=weight / weight.sum()))]
            start = int(rng.integers(max(1, len(piece) - length + 1)))
            blocks.append(piece[start : start + length])
        rows = np.concatenate(blocks)[:needed]
        at = np.arange(ticks) * self.tick / self.period
        return np.stack([np.interp(at, np.arange(needed), column) for column in rows.T], axis=1)

    def sizes(self) -> list[RemainderSize]:
        """Give of each joint the missing torque's RMS, N m, worst first."""
        order = np.argsort(-self.rms)
        return [{"joint": self.joints[j], "rms": float(self.rms[j]), "unit": "N m"} for j in order]

    def regimes(self) -> dict[str, Regime]:
        """Regime -> share of the missing torque's power, and recordings that have half a block of it."""
        power = np.concatenate([(p**2).sum(axis=1) for p in self.pieces])
        enough = 0.5 * self.block / self.period
        out: dict[str, Regime] = {}
        for name, inside in (("free air", False), ("contact", True)):
            masks = [on == inside for on in self.touching]
            part = float(power[np.concatenate(masks)].sum() / max(power.sum(), 1e-12))
            out[name] = {"share": part, "recordings": sum(bool(mask.sum() >= enough) for mask in masks)}
        return out


def _even(m: Missing, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Give a recording's torque (k, nj) and whether it touches (k,), every `period` s."""
    at = np.arange(m.time[0], m.time[-1] + 1e-9, period)
    rows = np.stack([np.interp(at, m.time, column) for column in m.torque.T], axis=1)
    near = np.clip(np.searchsorted(m.time, at - 1e-9), 0, len(m.time) - 1)
    return rows, m.touching[near]
