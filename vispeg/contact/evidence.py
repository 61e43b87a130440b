"""Recordings with a wrench as evidence on contact, with the face of `vispeg.identify.Evidence`.

The compared value is the wrench that the flange puts on the tool: measured, against what keeps each world's hand on the
measured path; both as means over blocks of `BLOCK` s. Source of the idea, with both signals in error: total least
squares, Golub and Van Loan 1980, An analysis of the total least squares problem.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vispeg.contact.drive import Driven, built_alike, drive
from vispeg.contact.floors import floors
from vispeg.contact.hand import Grasp, grasp, hand
from vispeg.contact.nuisance import PLACE, TURN, nuisance
from vispeg.contact.path import Path, along
from vispeg.contact.phases import Phases, phases
from vispeg.contact.sensor import hand_world, readings, stands_for, trusted
from vispeg.contact.thin import PART, driven_blocks, pieces, thinned
from vispeg.contact.torques import calm, notes
from vispeg.contact.yielding import given_way
from vispeg.core.effect import Effect
from vispeg.core.errors import UserError
from vispeg.identify.channels import Channel, Item
from vispeg.identify.evidence import PENALTY, Evidence
from vispeg.recordings.cell import WrenchSensor
from vispeg.recordings.recording import Control, Recording
from vispeg.robots.scene import Scene
from vispeg.sim.external import External
from vispeg.sim.segments.segment import Segment
from vispeg.sim.touch import Touch, touch
from vispeg.worlds.world import World

BLOCK = 0.04  # s: of a solver's chatter a mean over it leaves little
H_MAX = 1e-3  # s, physics step, at most: at twice this a slide drags by 10 % less than its friction
FAR = 4.0  # whitened residuals beyond this count less
TIE = 0.02  # of the greatest difference between two worlds in a block of time, up to which the others are ties
SECONDS = 15.0  # of contact that is driven, over all recordings
ROWS = 64  # worlds that are driven at once


@dataclass(frozen=True)
class Touching:
    """A recording of contact.

    Attributes:
        recording: with measured angles.
        scene: the cell as the user believes it.
        believed: effects that are part of that belief.
        wrench: (n, 6) N, N m: what the flange puts on the tool, flange axes.
        torques: what joint torques tell of it where no sensor read it; None where one did.
    """

    recording: Recording
    scene: Scene
    wrench: np.ndarray
    believed: World = field(default_factory=World)
    torques: External | None = None


@dataclass(frozen=True)
class ContactItem(Item):
    """One episode: two channels, force and torque, three columns each, a row a block."""

    path: Path = None  # type: ignore[assignment]
    phase: Phases = None  # type: ignore[assignment]
    source: Touching = None  # type: ignore[assignment]
    hand: Scene = None  # type: ignore[assignment]
    grasp: Grasp = None  # type: ignore[assignment]
    floor: np.ndarray = None  # type: ignore[assignment]  (m, 6)
    answer: np.ndarray = None  # type: ignore[assignment]  (6, m, 6), see `displaced`

    @property
    def nj(self) -> int:
        """Axes."""
        return 3

    @property
    def sigma(self) -> np.ndarray:  # type: ignore[override]
        """(m, 6): the floor of the block's phase."""
        return self.floor

    @property
    def period(self) -> float:
        """Time between blocks, s."""
        return BLOCK


class ContactEvidence(Evidence):
    """Recordings of contact and the machine that drives worlds' hands along them.

    Args:
        touching: recordings, each with its cell.
        nthread: of the batch.
    """

    least_gain = 0.02
    most_effects = 6
    decisive = 60.0
    alike = 0.03  # laws of contact are off by as much of a force, see `floors.SHARE`
    rough = 5.0  # where contacts come and go, worlds 1e-3 of an effect apart differ by 5 to 15
    correlated = 6.0  # blocks: form errors last as long as a contact does
    lasting = 14.0  # blocks that a visit to a phase takes: as long, an error of form acts on a parameter one way
    tied = correlated * 5.41  # of chi squared with one degree of freedom: one in 50

    def __init__(self, touching: Sequence[Touching], *, nthread: int = 1):
        self.recordings, self.nthread = [t.recording for t in touching], nthread
        force, place = trusted([t.recording for t in touching], [t.torques is None for t in touching])
        self.hold = grasp(force, place)
        hands: dict[int, Scene] = {}
        self.items: list[ContactItem] = []
        for t in touching:
            scene = hands.setdefault(id(t.scene), hand(t.scene, self.hold))
            self.items += _items(t, scene, SECONDS / len(touching), self.hold, nthread)
        self.nuisance = nuisance(self.items)
        self.left_out = [~driven_blocks(i.phase, pieces(i.phase)) & ~i.phase.resting for i in self.items]
        shown = [np.repeat(~out, i.measured.shape[1]) for i, out in zip(self.items, self.left_out, strict=True)]
        self.nuisance_in_part = self.nuisance.of_rows(np.concatenate(shown))
        self.notes: list[str] = notes([(t.recording, t.torques) for t in touching])
        self.absent: set[tuple[str, str]] = set()
        self.floor_from = "simulated repeats with the stated noise"
        self._recent = []
        self.rollouts = 0.0

    def tells(self, difference: np.ndarray) -> np.ndarray:
        """Ties left out: an effect of contact shows in few blocks, and hardly in most."""
        size = np.abs(difference)
        return size >= max(1.0, TIE * float(size.max(initial=0.0)))

    def errors(self, cost: float) -> float:
        """Variance of errors that an effect is judged by where a fit leaves `cost`, both in units of floors.

        Floors allow for errors that a good sensor has not. Where less is left, that is what counts, but as what may
        last as long as a visit to a phase. Intervals, which have no second recording that judges them, stay wide.
        """
        return max(min(1.0, cost * self.lasting / self.correlated), cost)

    def frees(self, kind: Effect, name: str) -> bool:
        """Parameters that a diagnosis of contact tries at some size, less those that a search found to be absent."""
        tried = name in kind.sizes or name in kind.beside or not kind.sizes
        return tried and (kind.name, name) not in self.absent

    def nudge(self, kind: Effect, name: str) -> float | None:
        """The smallest size that is tried: where contacts come and go, a shorter step shows the roughness alone."""
        p = kind.params[name]
        if name in kind.beside:
            return 0.5 * abs(p.start - p.null)
        if name not in kind.sizes:
            return None
        size = np.abs(np.log(kind.sizes[name]) if p.scale == "log" else np.array(kind.sizes[name]) - p.null)
        return float(size.min())

    def each_residual(self, worlds: Sequence[World]) -> Iterator[np.ndarray]:
        """Whitened residuals, one world after another; a square grows as its amount beyond `FAR` (Huber's loss)."""
        per_item = self.simulated(worlds)
        for w in range(len(worlds)):
            yield np.concatenate([r.ravel() for r in self.whitened([y[w] for y in per_item])])

    def whitened(self, predicted: Sequence[np.ndarray], part: bool = False) -> list[np.ndarray]:
        """(m, 6) of each item: what a world leaves, without what the items' sensors and kinematics leave open."""
        parts = [self.whiten(item, y) for item, y in zip(self.items, predicted, strict=True)]
        errors = self.nuisance_in_part if part else self.nuisance
        flat = errors.whitened(np.concatenate([p.ravel() for p in parts]))
        size = np.abs(flat)
        flat = np.where(size > FAR, np.sign(flat) * np.sqrt(FAR * np.maximum(2 * size - FAR, 0.0)), flat)
        ends = np.cumsum([p.size for p in parts])[:-1]
        return [r.reshape(p.shape) for r, p in zip(np.split(flat, ends), parts, strict=True)]

    @property
    def unit(self) -> str:
        """Of the principal channel."""
        return "N"

    def _simulated(self, worlds: Sequence[World], part: bool = False) -> list[np.ndarray]:
        self.rollouts += len(worlds) * sum(i.path.time[-1] for i in self.items) / (PART if part else 1)
        out = [np.empty((len(worlds), *i.measured.shape)) for i in self.items]
        for rows in built_alike(worlds):
            for item, values in zip(self.items, out, strict=True):
                windows = pieces(item.phase) if part else item.phase.windows
                for some in np.split(rows, range(ROWS, len(rows), ROWS)):
                    these = [worlds[r] for r in some]
                    values[some] = predicted(item, driven(item, these, self.nthread, windows), these)
        return out

    def residuals_in_part(self, worlds: Sequence[World]) -> list[np.ndarray]:
        """Whitened residuals of about one block in `PART`, the others 0: what many worlds are screened by."""
        per_item = self._simulated(worlds, part=True)
        for item, values, left_out in zip(self.items, per_item, self.left_out, strict=True):
            values[:, left_out] = item.measured[left_out]
        residuals = [self.whitened([y[w] for y in per_item], part=True) for w in range(len(worlds))]
        return [np.concatenate([r.ravel() for r in parts]) for parts in residuals]

    def simulated(self, worlds: Sequence[World]) -> list[np.ndarray]:
        """Per item, the wrench (nworld, m, 6) in blocks that the worlds need for the measured path."""
        key = tuple(worlds) if len(worlds) <= 4 else None
        for cached, answer in self._recent:
            if cached == key:
                return answer
        answer = self._simulated(worlds)
        if key is not None:
            self._recent = [(key, answer), *self._recent[:7]]
        return answer

    @property
    def floors(self) -> np.ndarray:
        """(6,) RMS floor of each column, N and N m."""
        total = sum((i.valid * i.sigma**2).sum(axis=0) for i in self.items)
        return np.sqrt(total / np.maximum(sum(i.valid.sum(axis=0) for i in self.items), 1))

    @property
    def floor(self) -> float:
        """RMS floor of the force, N."""
        return float(np.sqrt(np.mean(self.floors[:3] ** 2)))

    def excited(self, world: World) -> dict[str, float]:
        """Seconds in each phase of contact over all items."""
        out: dict[str, float] = {}
        for item in self.items:
            for name in item.phase.names:
                out[name] = out.get(name, 0.0) + BLOCK * float(np.sum(item.phase.of(name)))
        return out


def driven(
    item: ContactItem, worlds: Sequence[World], nthread: int = 1, windows: Sequence[slice] | None = None
) -> Driven:
    """Hands of worlds of one structure along one item's path, or along some windows of it."""
    hand_worlds = [hand_world(item.source.believed, w) for w in worlds]
    wrench = np.stack([readings(item.path, item.hand, w) for w in hand_worlds])
    windows = item.phase.windows if windows is None else windows
    cell, rest, way = item.source.scene, item.phase.rest, given_way(item, hand_worlds, wrench)
    return drive(item.hand, cell, item.path, hand_worlds, wrench, rest, windows, nthread, way=way)


def displaced(item: ContactItem, nominal: Driven, nthread: int = 1) -> np.ndarray:
    """(6, m, 6) how the wrench answers where the hand is off its path by `PLACE` or `TURN`, an axis each.

    Along the tool's axis it is deeper by that. `nominal` is how the believed model went along the path itself.
    """
    off = np.diag(np.repeat([PLACE, TURN], 3))
    world = hand_world(item.source.believed, World())
    wrench = np.repeat(readings(item.path, item.hand, world)[None], 6, axis=0)
    phase, scenes = item.phase, (item.hand, item.source.scene)
    out = drive(*scenes, item.path, [world] * 6, wrench, phase.rest, phase.windows, nthread, off)
    return np.nan_to_num(phase.means(out.correction) - phase.means(nominal.correction))


def predicted(item: ContactItem, out: Driven, worlds: Sequence[World]) -> np.ndarray:
    """(nworld, m, 6): measured wrench, less the zero found in free air, plus the correction, as the sensor reads it.

    While the hand rests at the start, the zero itself is what is compared. Forces are told as readings, whatever a
    world says that these stand for: errors are the sensor's, and what reads less would seem to fit them better.
    """
    correction = np.where(item.phase.resting[None, :, None], -out.zero[:, None], item.phase.means(out.correction))
    each = [stands_for(item.path, item.hand, hand_world(item.source.believed, w)) for w in worlds]
    return item.measured[None] + correction / np.array(each)[:, None, None]


def _items(t: Touching, scene: Scene, seconds: float, hold: Grasp, nthread: int) -> list[ContactItem]:
    rec = t.recording
    number = np.zeros(len(rec.time), int) if rec.episode is None else rec.episode
    calmed = rec if t.torques is None else calm(rec, t.torques)
    felt = touch(replace(calmed, wrench=rec.wrench or WrenchSensor()), t.scene)
    assert felt is not None  # `touching` refused a recording without a wrench
    episodes = np.unique(number)
    each = seconds / len(episodes)
    out = [_item(t, felt, scene, np.flatnonzero(number == n), each, hold, nthread) for n in episodes]
    out = [i for i in out if i is not None]
    if not out:
        raise UserError(
            "no episode begins in free air", file=rec.path, expected="0.3 s or more before the first contact"
        )
    return out


def _item(
    t: Touching, felt: Touch, scene: Scene, rows: np.ndarray, seconds: float, hold: Grasp, nthread: int
) -> ContactItem | None:
    rec = t.recording
    path = along(t.scene, rec, t.wrench, rows, H_MAX, t.believed)
    phase = phases(t.scene, felt, path, BLOCK)
    if phase is None:
        return None
    phase = thinned(phase, seconds)
    time = phase.time
    blank = np.zeros((len(time), len(rec.joints)))
    segment = Segment(
        Control("unknown", rec.rate_hz), BLOCK, {}, blank, blank, blank, time, rows[phase.rows(path.clock)]
    )
    measured = phase.means(path.wrench[None])[0]
    sigma = np.ones_like(measured)
    item = ContactItem(rec, segment, t.scene, (), path, phase, t, scene, hold, sigma)
    nominal = driven(item, [World()], nthread)
    sigma = floors(item, nominal, nthread)
    answer = displaced(item, nominal, nthread)
    valid = np.isfinite(measured) & phase.valid[:, None]
    parts = (("force", slice(0, 3)), ("moment", slice(3, 6)))
    channels = tuple(Channel(name, measured[:, p], sigma[:, p], valid[:, p]) for name, p in parts)
    return ContactItem(rec, segment, t.scene, channels, path, phase, t, scene, hold, sigma, answer)


__all__ = ["PENALTY", "ContactEvidence", "ContactItem", "Touching", "driven", "predicted"]
