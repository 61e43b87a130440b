"""Compare recordings with rollouts of many candidate worlds.

An evidence holds recordings and gives the whitened residual of any world on them: (measured - predicted) / sigma, where
sigma is the noise, flat over all items, samples and columns. Angles are always compared; measured torques too if the
sensor's placement is stated, and a servo's load. A held-out evidence is one to which no effect is fitted.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, Self

import numpy as np

from vispeg.core.effect import Effect, EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.memory import large_apart
from vispeg.core.rules import RULES
from vispeg.identify.channels import Channel, Item, shows
from vispeg.identify.contact import ALWAYS, Contact, contact_of
from vispeg.identify.load import load_noise, unsigned, with_gains
from vispeg.identify.loops.opened import OPEN, torque_if_saturated
from vispeg.identify.loops.runaway import said, without_runaway
from vispeg.identify.loops.stops import passed
from vispeg.identify.nominal import nominal_robot, robot_of
from vispeg.identify.space import Freedom
from vispeg.recordings.checks import missing
from vispeg.recordings.noise import noise_of
from vispeg.recordings.recording import Recording
from vispeg.sim.rollout import Response, simulate
from vispeg.sim.segments.segment import EXTERNAL, segments
from vispeg.sim.shares import processes, shared
from vispeg.worlds.world import World

SOFT_STEP = 0.5  # factor of the physics step under OSC: its soft null space amplifies integration error
SERVO_STEP = 2.5e-3  # s: a servo is no faster than 150 rad/s; a rollout takes less where `stable_step` of the arm is
MODEL_SIGMA = 4e-6  # rad: accuracy of the integrator
PENALTY = 1e4  # whitened residual of a rollout that diverged
# Most readings in one evidence; beyond it samples are thinned evenly, since memory grows as readings times parameters
# and candidates. The cases of scripts/bench/hidden_effects have 70,000; more would only narrow their intervals.
READINGS = 150_000
LEAST_HZ = 50.0  # least rate of compared samples: a block of time (0.25 s) then still has a dozen
AT_ONCE = 128e6  # bytes of rollouts in memory at once per process
ROWS = 64  # rollouts per batch and process: every effect in a batch is evaluated for all of its rows
WORLDS = 32  # worlds simulated at once, whatever the number of segments


class Evidence(Freedom):
    """A set of recordings, and the simulation of worlds against them.

    Channels with other errors than joints override some of the properties from `least_gain` to `stretches`, by which
    a search judges.

    Args:
        recordings: with a known controller.
        h_max: greatest physics step, s; that of servos is at least 2.5 ms, that under OSC half of it (`step_of`).
        nthread: processors to use, for processes that share the worlds, or threads if there are few worlds.

    Attributes:
        items: pieces of the recordings that are compared, in the order of the residual.
        notes: messages for the user on what was left out or changed.
        converted: the notes on recordings that were cut or converted; an evidence of the changed ones lacks them.
        floor_from: where the noise is known from, in words.
    """

    h_max: float = 0.0  # of an evidence that integrates nothing
    groups: Sequence[Sequence[int]] = ()  # likewise

    def __init__(self, recordings: Sequence[Recording], *, h_max: float = 1e-3, nthread: int = 1):
        large_apart()  # memory of large arrays goes back to the system when they are freed
        sound = [without_runaway(rec, nominal_robot(rec), 2.0 * _settle(rec)) for rec in recordings]
        self.recordings, self.nthread = [torque_if_saturated(rec, robot_of(rec)) for rec in sound], nthread
        self.h_max = h_max
        touched = [(rec, contact_of(rec, robot_of(rec))) for rec in self.recordings]
        strides = _strides(self.recordings)
        pairs = zip(touched, strides, strict=True)
        self.items = [i for (rec, contact), stride in pairs for i in self._items(rec, contact, stride)]
        groups: dict[tuple, list[int]] = {}
        for i, item in enumerate(self.items):
            c = item.recording.control
            key = (id(item.robot), c.mode, c.rate_hz, id(c.nullspace))
            groups.setdefault(key, []).append(i)
        self.groups = list(groups.values())
        self.notes = [_used(rec, n) for rec, n in zip(recordings, strides, strict=True) if rec.chosen or n > 1]
        self.notes += [line for rec in recordings for line in missing.said(rec)]
        self.notes += [contact.said(rec.name) for rec, contact in touched if contact is not None]
        self.converted = [said(rec, part) for rec, part in zip(recordings, sound, strict=True) if part is not rec]
        self.converted += [OPEN.format(a.name) for a, b in zip(self.recordings, sound, strict=True) if a is not b]
        self.notes += self.converted
        self.notes += _stops(self.recordings)
        self.floor_from = "stated noise" if all("q" in r.noise for r in recordings) else "estimated"
        self._recent: list[tuple[tuple[World, ...], list[np.ndarray]]] = []

    @property
    def least_gain(self) -> float:
        """Share of the held-out squared error that an added effect must remove."""
        return RULES.gain

    @property
    def most_effects(self) -> int:
        """Largest number of effects that a search may add."""
        return RULES.effects

    def sees(self, kind: Effect) -> bool:
        """Return whether an effect is visible in some channel of this evidence."""
        return any(shows(kind, channel) for channel in {c.kind for i in self.items for c in i.channels})

    @property
    def decisive(self) -> float:
        """Drop of the squared whitened residual that decides between two worlds by itself; infinite: none does."""
        return np.inf

    @property
    def alike(self) -> float:
        """Share of an effect's gain by which a rival may fall short and still be its equal.

        It is above 0 in a channel in which the error of the model's form is correlated over time.
        """
        return 0.0

    @property
    def tied(self) -> float:
        """Drop of the held-out squared residual within chance: smaller differences do not rank two worlds."""
        return 0.0

    @property
    def rough(self) -> float:
        """Change of the squared residual that is only chatter of the physics solver; 0 if the residual is smooth."""
        return 0.0

    @property
    def correlated(self) -> float:
        """Number of consecutive readings that share one error of the size of the noise floor."""
        return 1.0

    def tells(self, difference: np.ndarray) -> np.ndarray:
        """Return whether each time block, given its difference in loss, distinguishes two worlds, (n,) bool."""
        return np.ones(len(difference), bool)

    def stretches(self, blocks: np.ndarray) -> np.ndarray:
        """Return the number (nblock,) of the stretch to which each block belongs; here each is one of its own.

        Errors of blocks in a stretch are correlated, so they count as one. `blocks` (n,) is as `blocks()` returns it.
        """
        return np.arange(int(blocks.max()) + 1)

    @property
    def unit(self) -> str:
        """Unit of the principal channel."""
        return self.items[0].channels[0].unit

    def simulated(self, worlds: Sequence[World]) -> list[np.ndarray]:
        """Return for each item the predicted channels side by side (nworld, m, nch); recent answers are cached."""
        key = tuple(worlds) if len(worlds) <= 4 else None
        for worlds_key, answer in self._recent:
            if worlds_key == key:
                return answer
        answer = with_gains(self.items, self._simulated(worlds))
        if key is not None:
            size = max(1, sum(y.nbytes for y in answer))
            # with the older answers that fit into a quarter of `AT_ONCE`, seven at most
            self._recent = [(key, answer), *self._recent[: min(7, int(AT_ONCE / 4 / size))]]
        return answer

    def _simulated(self, worlds: Sequence[World]) -> list[np.ndarray]:
        """Roll out the worlds, shared between processes if that is worth it."""
        count = processes(self.nthread, len(worlds))
        if count == 1:
            return self._rolled_out(worlds, self.nthread)
        return shared(lambda part: self._rolled_out(part, 1), worlds, [i.measured.shape for i in self.items], count)

    def coarser(self) -> Self:
        """Return this evidence simulated with physics steps twice as long, for differences between worlds."""
        out = copy(self)
        out.h_max, out._recent = 2.0 * self.h_max, []
        return out

    def steps(self, world: World) -> list[float]:
        """Return the physics steps, s, at which a world is rolled out, one for each of the `groups`."""
        return [self.step_of(self.items[group[0]].segment.control.mode, world) for group in self.groups]

    def step_of(self, mode: str, *worlds: World) -> float:
        """Return the greatest physics step, s, at which these worlds are rolled out together under a control mode."""
        usual = {"osc": self.h_max * SOFT_STEP, "servo": max(self.h_max, SERVO_STEP)}.get(mode, self.h_max)
        return min([usual, *(_stable_step(e) for w in worlds for e in w.effects)])

    def _rolled_out(self, worlds: Sequence[World], nthread: int) -> list[np.ndarray]:
        """Roll out the worlds: together all items of one robot and controller, and all worlds of one physics step.

        So one world's fine step does not slow the others.
        """
        out: list[np.ndarray] = [np.empty((len(worlds), *i.measured.shape)) for i in self.items]
        for group in self.groups:
            items = [self.items[i] for i in group]
            steps = np.array([self.step_of(items[0].segment.control.mode, w) for w in worlds])
            for step in np.unique(steps):
                rows = np.flatnonzero(steps == step).tolist()
                alike, segments = [worlds[r] for r in rows], [i.segment for i in items]
                responses = simulate(items[0].robot, alike, segments, h_max=float(step), nthread=nthread, along=True)
                for i, item, response in zip(group, items, responses, strict=True):
                    predicted = [self.predicted(c, item, response, alike) for c in item.channels]
                    out[i][rows] = np.concatenate(predicted, axis=2)
        return out

    def compared(
        self, rec: Recording, rows: np.ndarray, late: np.ndarray, noise: Mapping[str, np.ndarray]
    ) -> tuple[Channel, ...]:
        """Return the channels of a recording that are compared, the principal one first.

        Args:
            rec: the recording.
            rows: (m,) indices of its samples.
            late: (m, 1) bool, whether a sample may count: after the start has settled, and in free air.
            noise: standard deviations of the recording's own signals (`noise_of`).
        """
        q = rec.q[rows]
        kind = "servo" if rec.control.mode == "servo" else "angle"
        channels = [Channel(kind, q, np.hypot(noise["q"], MODEL_SIGMA), np.isfinite(q) & late)]
        if rec.tau is not None and rec.torque_sensor != "none":
            channels.append(Channel("torque", rec.tau[rows], noise["tau"], np.isfinite(rec.tau[rows]) & late))
        if rec.load is not None and kind == "servo":
            load = rec.load[rows]
            channels.append(Channel("load", load, load_noise(rec.load), np.isfinite(load) & late))
        return tuple(channels)

    def predicted(self, channel: Channel, item: Item, response: Response, worlds: Sequence[World]) -> np.ndarray:
        """Return a channel's values predicted by rollouts of worlds, (nworld, m, nj)."""
        if channel.kind == "load":
            return np.abs(response.tau_motor) if unsigned(item.recording) else response.tau_motor
        if channel.kind == "torque":
            return response.tau_joint if item.recording.torque_sensor == "joint" else response.tau_motor
        return response.q

    def _items(self, rec: Recording, contact: Contact | None, stride: int) -> list[Item]:
        """Return an item for each segment of a recording that is long enough, with one in `stride` of its samples.

        Raises:
            UserError: nothing of the recording can be compared.
        """
        robot, settle, noise, out = robot_of(rec), _settle(rec), noise_of(rec), []
        long = [segment for segment in segments(rec) if segment.time[-1] > 2 * settle]
        if not long:
            raise UserError(f"too short to compare: every episode lasts under {2 * settle} s", file=rec.path)
        for segment in long:
            fresh = np.ones(len(segment.rows), bool) if rec.held is None else ~rec.held[segment.rows]
            # every `stride`-th sample, or the reading that it repeats
            thin = np.unique(np.maximum.accumulate(np.where(fresh, np.arange(len(fresh)), 0))[::stride])
            segment = replace(segment, time=segment.time[thin], rows=segment.rows[thin])
            late = (segment.time >= settle)[:, None]
            if rec.compared is not None:
                late = late & rec.compared[segment.rows][:, None]
            if contact is not None:
                free = contact.free[segment.rows]
                if not free.any():
                    continue
                segment = segment.until(int(np.flatnonzero(free)[-1]) + 1)  # the rest is not compared
                late = (late & free[:, None])[: len(segment.time)]
                grid = (np.arange(segment.ticks) + 0.5) * segment.tick  # what is held over a tick is its middle's
                torque = contact.torque[segment.rows].T
                segment.cache[EXTERNAL] = np.stack([np.interp(grid, segment.time, joint) for joint in torque], axis=1)
            channels = self.compared(rec, segment.rows, late, noise)
            if channels[0].valid.any():
                out.append(Item(rec, segment, robot, channels))
        if not out and contact is not None:
            raise UserError(ALWAYS, file=rec.path, expected="a second or more in free air")
        if not out:
            raise UserError(f"no reading after the first {settle} s of an episode can be compared", file=rec.path)
        return out

    def residuals(self, worlds: Sequence[World]) -> list[np.ndarray]:
        """Return for each world the whitened residual of all items, flat.

        Entries that are not compared are 0; those of a diverged rollout are PENALTY.
        """
        return [*self.each_residual(worlds)]

    def each_residual(self, worlds: Sequence[World]) -> Iterator[np.ndarray]:
        """Yield the residual of each world in turn, so that memory stays small for long recordings."""
        size = sum(4 * 8 * item.segment.ticks * item.nj for item in self.items)  # four signals per rollout
        batch = max(1, min(max(WORLDS, ROWS // len(self.items)), int(AT_ONCE / size))) * self.nthread
        for start in range(0, len(worlds), batch):
            per_item = self.simulated(worlds[start : start + batch])
            for w in range(len(per_item[0])):
                parts = [self.whiten(item, y[w]).ravel() for item, y in zip(self.items, per_item, strict=True)]
                yield np.concatenate(parts)

    def each_pair(
        self, world: World, residual: np.ndarray, worlds: Iterable[World]
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield for each of `worlds` the residual of `world` and its own, both simulated with the same physics step.

        The step is twice as long as usual (`coarser`), unless an effect needs a shorter one (`Effect.stable_step`): the
        error of a step is nearly the same with and without an effect, so a difference changes by about 0.3 %, and that
        of a narrow Stribeck peak by up to a third. `residual` is that of `world` at the usual step.
        """
        coarse, others = self.coarser(), list(worlds)
        after = coarse.each_residual([world, *others] if others else [])
        base, usual = next(after, residual), coarse.steps(world)
        for other, r in zip(others, after, strict=True):
            yield base if coarse.steps(other) == usual else residual, r

    @staticmethod
    def whiten(item: Any, predicted: np.ndarray) -> np.ndarray:
        """Return the whitened residual (m, nch) of one item from its prediction (m, nch)."""
        r = np.where(item.valid, (item.measured - predicted) / item.scale, 0.0)
        r = np.where(np.isfinite(r), np.clip(r, -PENALTY, PENALTY), PENALTY)
        return r

    def weigh(self, residual: np.ndarray) -> np.ndarray:
        """Weigh each column of each item by the error that a model leaves in it; return the residual's factors (n,).

        Where the mean squared error over noise is above the median of the column over all items, it counts as one at
        the median: the noise is widened. `residual` (n,) is that of the model, under the weights so far.
        """
        counts = [np.maximum(item.valid.sum(axis=0), 1) for item in self.items]
        errors = [total / n for total, n in zip(self.squares(residual), counts, strict=True)]
        wide = [np.ones_like(e) for e in errors]
        for pairs in self.columns.values():
            usual = max(1.0, float(np.median([errors[i][c] for i, c in pairs])))
            for i, c in pairs:
                wide[i][c] = max(1.0, errors[i][c] / usual) ** 0.5
        return self.widen(wide)

    def widen(self, wide: Sequence[np.ndarray | float]) -> np.ndarray:
        """Set the factors (nch,) by which each item's noise is widened; return the residual's factors (n,)."""
        before = self._widened()
        self.items = [replace(item, widened=w) for item, w in zip(self.items, wide, strict=True)]
        return before / self._widened()

    @property
    def weights(self) -> str:
        """Key of the present weights, with which stored answers about residuals are asked; "" if nothing is weighed."""
        wide = np.concatenate([np.atleast_1d(item.widened) for item in self.items])
        return "" if np.all(wide == 1.0) else hashlib.sha256(wide.tobytes()).hexdigest()

    def squares(self, residual: np.ndarray) -> list[np.ndarray]:
        """Return for each item the summed squared error over noise of each column, (nch,), whatever its weight."""
        raw, start, out = self.unweighted(residual), 0, []
        for item in self.items:
            out.append(np.sum(raw[start : start + item.measured.size].reshape(item.measured.shape) ** 2, axis=0))
            start += item.measured.size
        return out

    def unweighted(self, residual: np.ndarray) -> np.ndarray:
        """Return a residual (n,) in units of the noise, whatever its weights."""
        return residual * self._widened()

    def _widened(self) -> np.ndarray:
        """Return the factor (n,) by which the noise of each entry of a residual is widened."""
        return np.concatenate([np.broadcast_to(i.widened, i.measured.shape).ravel() for i in self.items])

    @property
    def length(self) -> int:
        """Number of entries of a residual."""
        return sum(item.measured.size for item in self.items)

    @property
    def count(self) -> int:
        """Number of valid readings."""
        return int(sum(i.valid.sum() for i in self.items))

    def chi2(self, residual: np.ndarray) -> float:
        """Return the mean square of a whitened residual over the valid readings."""
        return float(residual @ residual) / max(self.count, 1)

    def blocks(self, seconds: float | None = None) -> np.ndarray:
        """Return the block (n,) of every entry of a residual: a piece of one item, `seconds` long (`RULES.block`)."""
        out, start = [], 0
        for item in self.items:
            number = (item.segment.time / (seconds or RULES.block)).astype(int)
            out.append(np.repeat(number[:, None] + start, item.measured.shape[1], axis=1).ravel())
            start += number[-1] + 1
        return np.concatenate(out)

    def rms_error(self, residual: np.ndarray) -> float:
        """Return the RMS error of the principal channel, in `unit`, from a whitened residual, over valid readings."""
        total, n, start = 0.0, 0, 0
        for item in self.items:
            r = residual[start : start + item.measured.size].reshape(item.measured.shape)
            start += item.measured.size
            total += float(np.sum((r * item.scale)[:, : item.nj] ** 2))
            n += int(item.valid[:, : item.nj].sum())
        return float(np.sqrt(total / max(n, 1)))

    def errors(self, worlds: Sequence[World]) -> list[float]:
        """Return the RMS error of the principal channel under each world, in `unit`."""
        return [self.rms_error(r) for r in self.each_residual(worlds)]

    @property
    def columns(self) -> dict[tuple[str, str, int], list[tuple[int, int]]]:
        """Return for each column of the channels, by kind, unit and joint, the items that have it: (item, its column).

        The principal channel of every item is named after that of the first item, so that these share their columns;
        recordings may differ in the other channels.
        """
        out: dict[tuple[str, str, int], list[tuple[int, int]]] = {}
        for i, item in enumerate(self.items):
            principal, *others = item.channels
            named = [(self.items[0].channels[0], principal), *((c, c) for c in others)]
            keys = [(name.kind, name.unit, j) for name, c in named for j in range(c.measured.shape[1])]
            for column, key in enumerate(keys):
                out.setdefault(key, []).append((i, column))
        return out

    @property
    def floors(self) -> np.ndarray:
        """RMS noise of each of the `columns`, in its unit: the error of a perfect model."""
        out = []
        for pairs in self.columns.values():
            counted = [(self.items[i].valid[:, column].sum(), self.items[i].sigma[column]) for i, column in pairs]
            out.append(np.sqrt(sum(n * sigma**2 for n, sigma in counted) / max(sum(n for n, _ in counted), 1)))
        return np.array(out)

    @property
    def floor(self) -> float:
        """RMS noise of the principal channel, in `unit`: the error of a perfect model."""
        n = sum(i.valid[:, : i.nj].sum() for i in self.items)
        return float(np.sqrt(sum((i.valid * i.sigma**2)[:, : i.nj].sum() for i in self.items) / max(n, 1)))


def _used(rec: Recording, stride: int) -> str:
    """Return a note on which part of a long recording is used."""
    note = rec.chosen.said(rec.name) if rec.chosen else f"{rec.name}: all of it is simulated"
    return note if stride == 1 else f"{note}; one sample in {stride} is compared"


def _stable_step(placed: EffectInstance) -> float:
    """Return the greatest physics step, s, at which an effect is integrated stably."""
    return effect(placed.effect).stable_step({name: v.value for name, v in placed.params.items()})


def _stops(recordings: Sequence[Recording]) -> list[str]:
    """Return messages naming the joints that were measured beyond the stops of their model."""
    beyond = [j for rec in recordings for j in passed(nominal_robot(rec), rec.q)]
    return [f"{j} was measured beyond its range in the model, so that stop is left out" for j in dict.fromkeys(beyond)]


def _settle(rec: Recording) -> float:
    """Return how long the start of a segment is not compared, s: the start state is not measured exactly."""
    return RULES.settle if rec.control.mode in ("position", "servo") else RULES.settle_observed


def _strides(recordings: Sequence[Recording]) -> list[int]:
    """Return a number k for each recording: one in k of its samples is compared.

    At most about `READINGS` readings are compared in total, unless a rate would fall below `LEAST_HZ`.
    """
    signals = [1 + (r.tau is not None and r.torque_sensor != "none") + (r.load is not None) for r in recordings]
    readings = sum(n * r.q.size for n, r in zip(signals, recordings, strict=True))
    needed = int(np.ceil(readings / READINGS))
    return [max(1, min(needed, int(r.rate_hz / LEAST_HZ))) for r in recordings]
