"""The evidence of tosses: compare them window by window, each rollout starting from a measured state of the object.

A whole toss is a long chain of bounces: a small error in one becomes a large one after the next, so the end says
little about the stiffness of a contact. A window that starts just before a contact shows that contact alone
(Bianchini, Halm and Posa 2023, arXiv 2310.12054, on why long predictions are a poor loss for contact). The residual
is the pose at a window's end, measured minus predicted, divided by the error of windows in free flight: one window is
one reading of six values. Large residuals count linearly (Huber), since rollouts diverge at edges.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from vispeg.core.effect import REGISTRY, Effect
from vispeg.core.errors import UserError
from vispeg.core.robust import NORMAL, huber
from vispeg.core.rules import RULES
from vispeg.identify.evidence import Evidence
from vispeg.recordings.objects import ObjectRecording, turn_between
from vispeg.robots.objects import ObjectModel
from vispeg.sim.physics import derive
from vispeg.sim.placement import activate
from vispeg.sim.quiet import quiet
from vispeg.sim.state import Fields
from vispeg.worlds.world import World

SUBSTEPS = 6  # physics steps per sample, more if samples are over 7 ms apart
LONGEST_STEP = 1.2e-3  # s
ROWS = 8192  # rollouts per batch
LOST = 1e3  # whitened residual of a rollout that diverged
MOST = 1500  # largest number of windows; of more, whole tosses are dropped evenly
# What an effect may need (`Effect.needs`) that no toss has, and why. Without this a soft contact would be found: it may
# fit real impacts, which do not follow the simulator's law, while no pose shows how far the object sinks in at rest.
NO_TOSS_HAS = {"two forces": "at rest its own weight alone presses on it"}


@dataclass(frozen=True)
class Windows:
    """The windows of one toss: an item of the evidence.

    Attributes:
        recording: that the toss is in.
        robot: the object.
        first, last: (n,) first and last row of each window in the recording.
        sigma: (6,) standard deviation of the error in free flight, m and rad.
        nj: number of columns of `measured`.
    """

    recording: ObjectRecording
    robot: ObjectModel
    first: np.ndarray
    last: np.ndarray
    sigma: np.ndarray

    nj = 6

    @cached_property
    def measured(self) -> np.ndarray:
        """Measured pose at each window's end, (n, 6): position in m, and zeros.

        Predicted rotations are relative to the measured orientation.
        """
        end = self.recording.pose[self.last, :3]
        return np.column_stack([end, np.zeros_like(end)])

    @cached_property
    def valid(self) -> np.ndarray:
        """Validity, (n, 6) bool: every window counts."""
        return np.ones(self.measured.shape, bool)


class Restarts(Evidence):
    """Windows of tosses in which the object may touch something, compared with its model.

    Args:
        recordings: of one object, at one rate.
        model: the object.
        seconds: length of a window; None for whole tosses.
        sigma: (6,) noise to whiten by, m and rad; None takes it from the windows in free flight.
        nthread: threads of the simulation.

    Raises:
        UserError: recordings of another object or rate, or without windows of this length, contact, or, if the noise
            is asked of them, free flight.
    """

    def __init__(
        self,
        recordings: Sequence[ObjectRecording],
        model: ObjectModel,
        seconds: float | None,
        *,
        sigma: np.ndarray | None = None,
        nthread: int = 1,
    ):
        for rec in recordings:
            if rec.name_of != model.name:
                key = "object"
                raise UserError("another object than the model's", file=rec.path / "recording.yaml", key=key,
                                expected=model.name, got=rec.name_of)  # fmt: skip
        self.recordings, self.model, self.seconds, self.nthread = list(recordings), model, seconds, nthread
        self.rate = recordings[0].rate_hz
        for rec in recordings:
            if abs(rec.rate_hz / self.rate - 1) > 1e-6:
                raise UserError(
                    f"recorded at another rate than {recordings[0].name}", file=rec.path / "recording.yaml",
                    key="rate_hz", expected=self.rate, got=rec.rate_hz,
                )  # fmt: skip
        self.substeps = max(SUBSTEPS, int(np.ceil(1 / (self.rate * LONGEST_STEP))))
        self.compiled = model.compile(1 / (self.rate * self.substeps))
        windows = [w for rec in recordings for w in self._windows(rec)]
        touch = [self._touches(w) for w in windows]
        flight = [_selected(w, ~t) for w, t in zip(windows, touch, strict=True) if (~t).any()]
        hits = [_selected(w, t) for w, t in zip(windows, touch, strict=True) if t.any()]
        if not hits:
            raise UserError("the object never touches the table", file=recordings[0].path)
        self.flight = self._spread(flight)
        self.floor_from = "windows in free flight"
        if sigma is None:
            sigma = self._floor()
        self.sigma = sigma
        self.items = [replace(w, sigma=sigma) for w in self._spread(hits)]
        why = {name: NO_TOSS_HAS.get(kind.needs) for name, kind in sorted(REGISTRY.items()) if self._acts(kind)}
        self.notes = [f"{name}({model.name}) cannot be identified: {reason}" for name, reason in why.items() if reason]

    def _windows(self, rec: ObjectRecording) -> list[Windows]:
        """Return the windows of each toss, one after the other; tosses that are too short are left out."""
        out = []
        for rows in rec.tosses:
            length = rows.stop - rows.start - 1
            size = length if self.seconds is None else max(2, round(self.seconds * rec.rate_hz))
            if 2 <= size <= length:
                first = np.arange(rows.start, rows.stop - size, size)
                out.append(Windows(rec, self.model, first, first + size, np.ones(6)))
        if not out:
            raise UserError("every toss is shorter than a window", file=rec.path, expected=f"{self.seconds} s")
        return out

    def _touches(self, windows: Windows) -> np.ndarray:
        """Return whether the object may touch something within each window, (n,) bool, by its measured poses."""
        model, data = self.compiled, mujoco.MjData(self.compiled)
        lowest = _gaps(model, data, windows.recording.pose[windows.first[0] : windows.last[-1] + 1])
        start = windows.first[0]
        return np.array(
            [
                lowest[a - start : b - start + 1].min() < RULES.toss_near
                for a, b in zip(windows.first, windows.last, strict=True)
            ]
        )

    def _spread(self, windows: list[Windows]) -> list[Windows]:
        """Return at most MOST windows, leaving out whole tosses evenly."""
        total = sum(len(w.first) for w in windows)
        keep = np.linspace(0, len(windows) - 1, max(1, int(len(windows) * min(1.0, MOST / max(total, 1))))).astype(int)
        return [windows[i] for i in np.unique(keep)] if windows else []

    def _floor(self) -> np.ndarray:
        """Return the robust standard deviation (6,) of the error in free flight, one for position, one for rotation."""
        count = sum(len(w.first) for w in self.flight)
        if count < RULES.flights_least:
            raise UserError(
                f"only {count} windows in free flight",
                file=self.recordings[0].path,
                expected=f"{RULES.flights_least} or more, to tell the measurement's own error",
            )
        error = np.concatenate(
            [w.measured - y[0] for w, y in zip(self.flight, self._predicted([World()], self.flight), strict=True)]
        )
        return NORMAL * np.repeat([np.median(np.abs(error[:, :3])), np.median(np.abs(error[:, 3:]))], 3)

    @property
    def unit(self) -> str:
        """Unit of the position error at a window's end: metres."""
        return "m"

    def over(self, seconds: float | None) -> Restarts:
        """Return the same tosses in windows of another length, whitened by the same noise."""
        return Restarts(self.recordings, self.model, seconds, sigma=self.sigma, nthread=self.nthread)

    def sees(self, kind: Effect) -> bool:
        """Return whether an effect can act on the object, and tosses have what it needs."""
        return self._acts(kind) and kind.needs not in NO_TOSS_HAS

    def _acts(self, kind: Effect) -> bool:
        """Return whether the object is the only place of an effect."""
        return kind.targets(self.model) == list(self.model.free)

    def simulated(self, worlds: Sequence[World]) -> list[np.ndarray]:
        """Return for each toss the predicted poses at the windows' ends, (nworld, n, 6), as in `Windows.measured`."""
        return self._predicted(worlds, self.items)

    def each_residual(self, worlds: Sequence[World]) -> Iterator[np.ndarray]:
        """Yield for each world the whitened residual of all windows, flat."""
        per_toss = self.simulated(worlds)
        for k in range(len(worlds)):
            yield np.concatenate([self.whiten(w, y[k]).ravel() for w, y in zip(self.items, per_toss, strict=True)])

    @staticmethod
    def whiten(item: Windows, predicted: np.ndarray) -> np.ndarray:
        """Return the whitened residual (n, 6), damped so that its square grows linearly beyond `toss_far` (Huber)."""
        r = (item.measured - predicted) / item.sigma
        return huber(np.where(np.isfinite(r), np.clip(r, -LOST, LOST), LOST), RULES.toss_far)

    def blocks(self, seconds: float | None = None) -> np.ndarray:
        """Return the block of every residual entry: its toss, since only tosses are independent."""
        return np.concatenate([np.full(w.measured.size, i) for i, w in enumerate(self.items)])

    def errors(self, worlds: Sequence[World]) -> list[float]:
        """Return the RMS distance at the windows' ends under each world, m."""
        return [float(np.sqrt(np.mean(self.missed(w)[0] ** 2))) for w in worlds]

    def missed(self, world: World) -> tuple[np.ndarray, np.ndarray]:
        """Return distance (n,) m and angle (n,) rad between measured and predicted pose at every window's end."""
        error = np.concatenate([w.measured - y[0] for w, y in zip(self.items, self.simulated([world]), strict=True)])
        return np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)

    @property
    def floor(self) -> float:
        """RMS position error in free flight, m, without outliers."""
        return float(np.sqrt(3.0) * self.sigma[0])

    def _predicted(self, worlds: Sequence[World], windows: Sequence[Windows]) -> list[np.ndarray]:
        """Return for each toss the predicted poses at the ends of its windows, (nworld, n, 6)."""
        first = np.concatenate([w.first for w in windows])
        length = np.concatenate([w.last - w.first for w in windows])
        pose = np.concatenate([w.recording.pose[w.first] for w in windows])
        rate = np.concatenate([w.recording.rate[w.first] for w in windows])
        end = np.concatenate([w.recording.pose[w.last] for w in windows])
        n = len(first)
        out = np.empty((len(worlds), n, 6))
        most = max(1, ROWS // n)
        for start in range(0, len(worlds), most):
            batch = worlds[start : start + most]
            poses = self._flown(batch, pose, rate, length)  # (k, n, 7)
            out[start : start + most, :, :3] = poses[..., :3]
            out[start : start + most, :, 3:] = turn_between(
                np.broadcast_to(end[:, 3:], poses[..., 3:].shape), poses[..., 3:]
            )
        cuts = np.cumsum([len(w.first) for w in windows])[:-1]
        return np.split(out, cuts, axis=1)

    def _flown(self, worlds: Sequence[World], pose: np.ndarray, rate: np.ndarray, length: np.ndarray) -> np.ndarray:
        """Return poses (nworld, n, 7) after `length` (n,) samples from n states of `pose` (n, 7) and `rate` (n, 6)."""
        from mujoco.batch import Batch

        k, n = len(worlds), len(pose)
        batch = Batch(self.compiled, k * n, self.nthread)
        fields = Fields(batch, self.model)
        for a in activate(self.model, worlds):
            a.effect.write(fields, {name: np.repeat(v, n, axis=0) for name, v in a.p.items()})
        derive(batch, fields)
        q, v = batch.bind("qpos"), batch.bind("qvel")
        q[:], v[:] = np.tile(pose, (k, 1)), np.tile(rate, (k, 1))
        out, span = np.empty((k * n, 7)), np.tile(length, k)
        alive, done = np.arange(k * n), 0
        with quiet():
            for stop in np.unique(span):
                batch.step(ids=alive, nstep=int(stop - done) * self.substeps)
                done, ended = stop, alive[span[alive] == stop]
                out[ended] = q[ended]
                alive = alive[span[alive] > stop]
        return out.reshape(k, n, 7)


def _selected(w: Windows, mask: np.ndarray) -> Windows:
    """Return the windows of a toss that a mask (n,) bool selects."""
    return replace(w, first=w.first[mask], last=w.last[mask])


def _gaps(model: mujoco.MjModel, data: mujoco.MjData, pose: np.ndarray) -> np.ndarray:
    """Return the gap (n,) m between the free body's shapes and the others in each pose, capped at 10 `toss_near`."""
    free = int(model.jnt_bodyid[0])
    mine = np.flatnonzero((model.geom_bodyid == free) & ((model.geom_contype | model.geom_conaffinity) != 0))
    others = np.flatnonzero((model.geom_bodyid != free) & ((model.geom_contype | model.geom_conaffinity) != 0))
    out = np.full(len(pose), 10 * RULES.toss_near)
    for i, p in enumerate(pose):
        data.qpos[:] = p
        mujoco.mj_kinematics(model, data)
        for a in mine:
            for b in others:
                out[i] = min(out[i], mujoco.mj_geomDistance(model, data, int(a), int(b), 10 * RULES.toss_near, None))
    return out
