"""Locate where the model fails: the missing torque of each joint, by regime.

Missing torque is what must be added to the model's joint torques so that it moves as measured. A regime is a kind of
motion: velocity reversal, high speed, high load or steady motion. An item is one compared stretch of a recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.diagnosis.evidence.phase import phase
from vispeg.diagnosis.schema import Failure, Peak
from vispeg.identify.channels import Item
from vispeg.recordings.differentiate import CUTOFF_HZ, smooth
from vispeg.recordings.recording import Control
from vispeg.sim.compiled import compiled
from vispeg.sim.nominal import Nominal
from vispeg.sim.observer import OBSERVER, observer_spring

SERVO = 25.0  # rad/s, assumed bandwidth of a servo's unknown loop, only to convert angles to torques
SLOW, FAST, LOADED = 0.1, 0.6, 0.7  # bounds of the regimes: shares of a joint's peak speed (two), of its peak torque


@dataclass(frozen=True)
class JointData:
    """One joint over all fitted items, end to end (n,): what `Effect.guesses` may use.

    The arrays are as in `MissingTorque`, except `raw`: the finite measured values, not smoothed; its length may differ.
    """

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    tau: np.ndarray
    needed: np.ndarray
    excess: np.ndarray
    raw: np.ndarray

    @property
    def missing(self) -> float:
        """Magnitude, N m, that nine in ten values of the missing torque do not exceed; at least 1 mN m."""
        return max(_nine_tenths(self.excess), 1e-3)

    @property
    def inertia(self) -> float:
        """Inertia, kg m^2, that takes as much torque as is missing.

        Far above it, as 0.4 kg m^2 in a wrist of 0.01, a rotor moves the arm by so much that no signature is linear.
        """
        return self.per(self.ddq)

    def per(self, signal: np.ndarray) -> float:
        """Return the missing torque over a signal (n,) that makes it: N m per unit of the signal."""
        return self.missing / max(_nine_tenths(signal), 1e-3)


def _nine_tenths(values: np.ndarray) -> float:
    """Return the magnitude that nine in ten values do not exceed."""
    return float(np.quantile(np.abs(values), 0.9))


@dataclass(frozen=True)
class MissingTorque:
    """The missing torque of one item.

    Attributes:
        time: (m,) s.
        q, dq, ddq: (m, nj) measured motion, smoothed.
        tau: (m, nj) N m, motor torque commanded with it; gravity alone if the command is unknown, and `needed` for a
            servo or measured torques.
        needed: (m, nj) N m, joint torque for that motion: of the nominal arm without Coriolis terms, or, if torques
            were measured, of the model itself.
        excess: (m, nj) N m, the missing torque.
        sigma: (nj,) standard deviation of `excess` if sensor noise were its only cause.
    """

    time: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    tau: np.ndarray
    needed: np.ndarray
    excess: np.ndarray
    sigma: np.ndarray


def missing_torque(item: Item, predicted: np.ndarray) -> MissingTorque:
    """Return the missing torque of an item under a model that predicts `predicted` (m, nch).

    Where torques are compared it is predicted minus measured torque. Where angles are compared it is, low-passed,
    `M d'' + Kd d' + Kp d` of the difference d = measured - simulated angle. Kp and Kd are the gains of the loop that
    robot and model share (the recorded controller, or the observer), M the nominal inertia along the motion. That is
    the linearised inverse of the loop, so a torque at one joint shows at that joint alone.
    """
    seg, nj, m = item.segment, item.nj, len(item.segment.time)
    if item.kind == "needed":
        valid = item.valid.any(axis=1)
        gap = _filled(predicted - item.measured)
        load = predicted[valid]
        q, dq, ddq = seg.q[valid], seg.dq[valid], seg.cache["ddq"][valid]
        return MissingTorque(seg.time[valid], q, dq, ddq, load, load, gap[valid], item.sigma)
    q, dq, ddq = smooth(seg.time, _filled(item.measured[:, :nj]), CUTOFF_HZ)
    nominal = Nominal(compiled(item.robot), item.robot.joints, item.robot.flange, m, 1)
    mass, _, _, _, gravity = nominal.operational(q)
    control = seg.control
    # apparent inertia (nj,) kg m^2, the least over at most 31 samples, for the observer's spring
    inertia = np.min(1.0 / np.diagonal(np.linalg.inv(mass[:: max(1, m // 16)]), axis1=1, axis2=2), axis=0)

    def torque(d: np.ndarray) -> np.ndarray:
        """Return the torque (m, nj) N m that makes a difference of angles (m, nj) rad in the loop."""
        d, rate, acc = smooth(seg.time, d, CUTOFF_HZ)
        if control.mode == "position":
            return np.einsum("nij,nj->ni", mass, acc) + control.kd * rate + control.kp * d
        # kp and kd act in proportion to inertia; the observer has in each joint a spring and a damper besides
        kp, kd, spring, damper = OBSERVER**2, 2 * OBSERVER, *observer_spring(item.robot, inertia)
        if control.mode == "osc":
            kp, kd, spring, damper = *_mean_gains(control), 0.0, 0.0
        elif control.mode == "servo":
            kp, kd, spring, damper = SERVO**2, 2.0 * SERVO, 0.0, 0.0
        return np.einsum("nij,nj->ni", mass, acc + kd * rate + kp * d) + damper * rate + spring * d

    difference = _filled(item.measured[:, :nj] - predicted[:, :nj])
    noise = np.random.default_rng(0).normal(size=(m, nj)) * item.sigma[:nj]
    valid = item.valid.any(axis=1)
    sigma = torque(noise)[valid].std(axis=0)
    raw = seg.q_raw if len(seg.q_raw) == m else item.measured[:, :nj]
    tau = _motor_torque(item, raw, dq, gravity)
    needed = np.einsum("nij,nj->ni", mass, ddq) + gravity
    tau = needed if control.mode == "servo" else tau
    time, q, dq, ddq, tau, needed = (v[valid] for v in (seg.time, q, dq, ddq, tau, needed))
    return MissingTorque(time, q, dq, ddq, tau, needed, torque(difference)[valid], np.maximum(sigma, 1e-9))


def _mean_gains(control: Control) -> tuple[float, float]:
    """Return the mean gains kp, kd of an operational-space loop; enough to convert angle differences to torques."""
    if control.kp is None or control.kd is None:
        return OBSERVER**2, 2 * OBSERVER
    return float(np.mean(control.kp)), float(np.mean(control.kd))


def _motor_torque(item: Item, q: np.ndarray, dq: np.ndarray, gravity: np.ndarray) -> np.ndarray:
    """Return the commanded joint torque (m, nj) at angles `q` and speeds `dq`; `gravity` (m, nj) if it is unknown."""
    seg, c = item.segment, item.segment.control
    at = np.clip(np.round(seg.time / seg.tick).astype(int), 0, seg.ticks - 1)
    if np.any(np.abs(seg.time - at * seg.tick) > 0.05 * seg.tick):  # the commands are of other instants
        return gravity
    command = {name: values[at] for name, values in seg.command.items()}
    comp = gravity if c.gravity_compensation == "model" else 0.0
    if c.mode == "torque":
        return command["tau_cmd"] + comp
    if c.mode == "position":
        return c.kp * (command["q_cmd"] - q) + c.kd * (command.get("dq_cmd", np.zeros_like(q)) - dq) + comp
    return gravity


def _filled(values: np.ndarray) -> np.ndarray:
    """Return values (m, k) with gaps (not finite) interpolated in each column; a column without any value is 0."""
    values = values.copy()
    for column in values.T:
        bad = ~np.isfinite(column)
        if bad.any() and not bad.all():
            column[bad] = np.interp(np.flatnonzero(bad), np.flatnonzero(~bad), column[~bad])
    return np.nan_to_num(values)


def joint_data(missing: Sequence[MissingTorque], items: list[Item]) -> list[JointData]:
    """Return one JointData per joint over all items."""
    nj = missing[0].q.shape[1]

    def column(get, j):
        return np.concatenate([get(k)[:, j] for k in missing])

    raw = [i.measured[i.valid.any(axis=1)] for i in items]
    return [
        JointData(
            column(lambda k: k.q, j),
            column(lambda k: k.dq, j),
            column(lambda k: k.ddq, j),
            column(lambda k: k.tau, j),
            column(lambda k: k.needed, j),
            column(lambda k: k.excess, j),
            np.concatenate([r[:, j][np.isfinite(r[:, j])] for r in raw]),
        )
        for j in range(nj)
    ]


def joint_z(missing: Sequence[MissingTorque]) -> np.ndarray:
    """Return the RMS missing torque over its noise, (nj,)."""
    return np.sqrt(np.mean([np.mean((k.excess / k.sigma) ** 2, axis=0) for k in missing], axis=0))


def regimes(k: MissingTorque) -> dict[str, np.ndarray]:
    """Return for each regime its samples, (m, nj) bool; each sample is in one regime."""
    speed, load = np.abs(k.dq), np.abs(k.tau)
    peak = np.maximum(speed.max(axis=0), 1e-6)
    reversal = speed < SLOW * peak
    return {
        "velocity reversal": reversal,
        "high speed": speed > FAST * peak,
        "high load": (load > LOADED * np.maximum(load.max(axis=0), 1e-6)) & ~reversal & (speed <= FAST * peak),
        "steady motion": ~reversal & (speed <= FAST * peak) & (load <= LOADED * np.maximum(load.max(axis=0), 1e-6)),
    }


def where_it_fails(missing: Sequence[MissingTorque], joints: tuple[str, ...], most: int = 6) -> list[Failure]:
    """Return the largest shares of the squared missing torque above noise by joint and regime, largest first.

    All shares sum to 1; at most `most` are returned, and none up to 1 %.
    """
    cells: dict[tuple[str, str], float] = {}
    for k in missing:
        chi = np.maximum((k.excess / k.sigma) ** 2 - 1.0, 0.0)
        for regime, mask in regimes(k).items():
            for j, joint in enumerate(joints):
                cells[joint, regime] = cells.get((joint, regime), 0.0) + float(np.sum(chi[:, j] * mask[:, j]))
    total = sum(cells.values()) or 1.0
    ranked = sorted(cells.items(), key=lambda c: -c[1])[:most]
    return [{"joint": j, "regime": r, "share": round(v / total, 4)} for (j, r), v in ranked if v / total > 0.01]


@dataclass(frozen=True)
class Cells:
    """The cells of one of the `maps`: edges (k+1,) along its axis, and the cell `number` (n, nj) of every sample.

    The number is -1 for a sample in no cell. Samples of all items are end to end.
    """

    edges: np.ndarray
    number: np.ndarray


def cells(missing: Sequence[MissingTorque], bins: int = 12) -> dict[str, Cells]:
    """Return for each axis the cells: speed and load (as shares of the joint's peak), position, phase and time."""
    out = {}
    for axis, get in (
        ("speed", lambda k: k.dq / np.maximum(np.abs(k.dq).max(axis=0), 1e-9)),
        ("load", lambda k: k.tau / np.maximum(np.abs(k.tau).max(axis=0), 1e-9)),
        ("position", lambda k: k.q),
        ("phase", lambda k: phase(k.time, k.dq)),
        ("time", lambda k: np.repeat(k.time[:, None], k.q.shape[1], axis=1)),
    ):
        x = np.concatenate([get(k) for k in missing])
        low, high = (0.0, 1.0) if axis == "phase" else (x.min(), x.max() + 1e-9)
        edges = np.linspace(low, high, bins + 1)
        number = np.clip(np.digitize(x, edges) - 1, 0, bins - 1)
        number[~np.isfinite(x)] = -1  # a phase is defined between turning points only
        out[axis] = Cells(edges, number)
    return out


def maps(
    missing: Sequence[MissingTorque], bins: int = 12, over: Sequence[MissingTorque] | None = None
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return for each axis the cells' edges (k+1,) and the RMS missing torque over its noise (nj, k), NaN if empty.

    The cells are those of `over`, the missing torques of the same samples under another model; by default their own.
    Where torques are compared, load is the torque that the model predicts, so two models put a sample into different
    cells of load. To compare their maps, pass the same `over` for both.
    """
    z = np.concatenate([(k.excess / k.sigma) ** 2 for k in missing])
    out = {}
    for axis, cell in cells(missing if over is None else over, bins).items():
        grid = np.full((z.shape[1], bins), np.nan)
        for j, number in enumerate(cell.number.T):
            inside = number >= 0
            count = np.bincount(number[inside], minlength=bins)
            total = np.bincount(number[inside], weights=z[inside, j], minlength=bins)
            grid[j] = np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)
        out[axis] = (cell.edges, grid)
    return out


def worst(
    missing: Sequence[MissingTorque], bins: int = 12, over: Sequence[MissingTorque] | None = None
) -> dict[str, np.ndarray]:
    """Return for each axis the index of the sample with the largest missing torque in each cell (nj, k), -1 if none.

    The cells are those of `over`, as in `maps`.
    """
    z = np.abs(np.concatenate([k.excess / k.sigma for k in missing]))
    out = {}
    for axis, cell in cells(missing if over is None else over, bins).items():
        at = np.full((z.shape[1], bins), -1)
        for j, number in enumerate(cell.number.T):
            for i in range(bins):
                rows = np.flatnonzero(number == i)
                at[j, i] = rows[np.argmax(z[rows, j])] if rows.size else -1
        out[axis] = at
    return out


def peaks(
    before: dict[str, tuple[np.ndarray, np.ndarray]],
    joints: tuple[str, ...],
    after: dict[str, tuple[np.ndarray, np.ndarray]] | None = None,
) -> list[Peak]:
    """Return the worst cell of each of the maps `before`, in multiples of the noise, and its value in maps `after`."""
    out = []
    for axis, (edges, grid) in before.items():
        if not np.isfinite(grid).any():
            continue
        j, i = np.unravel_index(int(np.nanargmax(grid)), grid.shape)
        row = {"axis": axis, "joint": joints[j], "from": float(edges[i]), "to": float(edges[i + 1])}
        row["times_noise"] = round(float(grid[j, i]), 2)
        out.append(row | ({"times_noise_after": round(float(after[axis][1][j, i]), 2)} if after else {}))
    return out
