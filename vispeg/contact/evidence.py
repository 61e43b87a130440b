"""Compare recordings with a wrench, with the interface of `vispeg.identify.Evidence`.

The compared value is the wrench of the flange on the tool: the measured one, against the one that keeps each world's
hand on the measured path, both as means over blocks of 40 ms. Source of the idea, with errors in both signals: total
least squares, Golub and Van Loan 1980, An analysis of the total least squares problem.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from vispeg.contact.drive import built_alike
from vispeg.contact.errors.nuisance import nuisance
from vispeg.contact.hand import hand
from vispeg.contact.inputs import ContactItem, Touching
from vispeg.contact.items import driven, items_of, predicted
from vispeg.contact.torques import notes
from vispeg.core.effect import Effect
from vispeg.core.robust import huber
from vispeg.core.rules import RULES
from vispeg.identify.evidence import Evidence
from vispeg.recordings.checks import missing
from vispeg.robots.scene import Scene
from vispeg.worlds.world import World

SECONDS = 15.0  # s of contact that are simulated, over all recordings
ROWS = 64  # worlds simulated at once


class ContactEvidence(Evidence):
    """Recordings of contact, and the simulation of worlds' hands along them.

    Args:
        touching: recordings, each with its cell.
        nthread: threads of the simulation.
    """

    def __init__(self, touching: Sequence[Touching], *, nthread: int = 1):
        self.recordings, self.nthread = [t.recording for t in touching], nthread
        hands: dict[int, Scene] = {}
        self.items: list[ContactItem] = []
        for t in touching:
            scene = hands.setdefault(id(t.scene), hand(t.scene))
            self.items += items_of(t, scene, SECONDS / len(touching), nthread)
        self.nuisance = nuisance(self.items)
        self.notes: list[str] = notes([(t.recording, t.torques) for t in touching])
        self.notes += [line for rec in self.recordings for line in missing.said(rec)]
        self.absent: set[tuple[str, str]] = set()
        self.floor_from = "simulated repeats with the stated noise"
        self._recent = []

    @property
    def least_gain(self) -> float:
        """Share of the held-out squared error that an added effect must remove."""
        return RULES.gain

    @property
    def most_effects(self) -> int:
        """Largest number of effects that a search may add."""
        return RULES.effects_few

    @property
    def decisive(self) -> float:
        """Drop of the held-out squared residual beyond chance: what is no tie."""
        return self.tied

    @property
    def alike(self) -> float:
        """Share of an effect's gain by which a competing effect may fall short and still be confounded with it."""
        return RULES.contact_alike

    @property
    def rough(self) -> float:
        """Change of the squared residual due to solver chatter."""
        return RULES.contact_rough

    @property
    def correlated(self) -> float:
        """Number of consecutive blocks with a correlated error of form, about the duration of a contact."""
        return RULES.contact_correlated

    @property
    def lasting(self) -> float:
        """Number of blocks of a visit to a phase, during which an error of form biases a parameter one way."""
        return RULES.contact_lasting

    @property
    def tied(self) -> float:
        """Drop of the held-out squared residual that a lasting error of form makes: smaller ones do not rank worlds."""
        return self.lasting * RULES.interval

    def stretches(self, blocks: np.ndarray) -> np.ndarray:
        """Return the number of the visit to a phase in which each block of residuals begins, (nblock,).

        `blocks` (n,) is the block of each residual. Errors of form persist through a visit, so its blocks count as one
        sample in comparing two worlds.
        """
        visits, start = [], 0
        for item in self.items:
            visit = start + np.cumsum(np.diff(item.phase.code, prepend=item.phase.code[0]) != 0)
            visits.append(np.repeat(visit, item.measured.shape[1]))
            start = int(visit[-1]) + 1
        out = np.zeros(int(blocks.max()) + 1, int)
        out[blocks[::-1]] = np.concatenate(visits)[::-1]
        return out

    def variance(self, cost: float) -> float:
        """Return the error variance for tests when a fit leaves `cost`, both in units of the floors.

        The floors include errors that a good sensor does not have. If less is left, the actual residual counts, as an
        error correlated over a visit to a phase. Intervals use the same variance, so that those of accepted effects
        exclude null.
        """
        return max(min(1.0, cost * self.lasting / self.correlated), cost)

    def frees(self, kind: Effect, name: str) -> bool:
        """Return whether a parameter may be fitted: not if it was found to be absent.

        Of an effect with trial sizes only those with sizes, and those `beside` them, may.
        """
        tried = name in kind.sizes or name in kind.beside or not kind.sizes
        return tried and (kind.name, name) not in self.absent

    def nudge(self, kind: Effect, name: str) -> float | None:
        """Return the smallest trial size as derivative step: a shorter one shows only the roughness of contact."""
        p = kind.params[name]
        if name in kind.beside:
            return 0.5 * abs(p.start - p.null)
        if name not in kind.sizes:
            return None
        size = np.abs(np.log(kind.sizes[name]) if p.scale == "log" else np.array(kind.sizes[name]) - p.null)
        return float(size.min())

    def each_residual(self, worlds: Sequence[World]) -> Iterator[np.ndarray]:
        """Yield each world's whitened residuals, Huber-damped: a square grows linearly beyond `contact_far`."""
        per_item = self.simulated(worlds)
        for w in range(len(worlds)):
            yield np.concatenate([r.ravel() for r in self.whitened([y[w] for y in per_item])])

    def whitened(self, predicted: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Return for each item the residual (m, 6) of a world, whitened by the covariance of nuisances."""
        parts = [self.whiten(item, y) for item, y in zip(self.items, predicted, strict=True)]
        flat = huber(self.nuisance.whitened(np.concatenate([p.ravel() for p in parts])), RULES.contact_far)
        ends = np.cumsum([p.size for p in parts])[:-1]
        return [r.reshape(p.shape) for r, p in zip(np.split(flat, ends), parts, strict=True)]

    @property
    def unit(self) -> str:
        """Unit of the principal channel."""
        return "N"

    def as_read(self, world: World) -> float:
        """Return the squared residual in floors, before nuisances are removed."""
        return float(np.sum(huber(self._as_read(world), RULES.contact_far) ** 2))

    def taken(self, world: World) -> dict[str, float]:
        """Return for each nuisance (error that is allowed for) the share of the squared residual that it explains."""
        return self.nuisance.taken(self._as_read(world))

    def _as_read(self, world: World) -> np.ndarray:
        predicted = self.simulated([world])
        return np.concatenate([self.whiten(item, y[0]).ravel() for item, y in zip(self.items, predicted, strict=True)])

    def _simulated(self, worlds: Sequence[World]) -> list[np.ndarray]:
        out = [np.empty((len(worlds), *i.measured.shape)) for i in self.items]
        for rows in built_alike(worlds):
            for item, values in zip(self.items, out, strict=True):
                for batch in np.split(rows, range(ROWS, len(rows), ROWS)):
                    part = [worlds[r] for r in batch]
                    values[batch] = predicted(item, driven(item, part, self.nthread), part)
        return out

    def simulated(self, worlds: Sequence[World]) -> list[np.ndarray]:
        """Return for each item the wrenches (nworld, m, 6) N and N m that worlds need to follow the measured path."""
        key = tuple(worlds) if len(worlds) <= 4 else None
        for cached, answer in self._recent:
            if cached == key:
                return answer
        answer = self._simulated(worlds)
        if key is not None:
            self._recent = [(key, answer), *self._recent[:7]]
        return answer

    def errors(self, worlds: Sequence[World]) -> list[float]:
        """Return the RMS of measured minus predicted force over the compared blocks, N, for each world.

        Unlike the residuals, it includes errors of the sensor's zero and of the path.
        """
        per_item, out = self.simulated(worlds), []
        for w in range(len(worlds)):
            pairs = zip(self.items, per_item, strict=True)
            missed = [np.where(i.valid, i.measured - y[w], 0.0)[:, :3] for i, y in pairs]
            total = sum(float(np.sum(m**2)) for m in missed)
            out.append(float(np.sqrt(total / max(sum(int(i.valid[:, :3].sum()) for i in self.items), 1))))
        return out

    @property
    def floors(self) -> np.ndarray:
        """RMS floor of each column, (6,) N and N m."""
        total = sum((i.valid * i.sigma**2).sum(axis=0) for i in self.items)
        return np.sqrt(total / np.maximum(sum(i.valid.sum(axis=0) for i in self.items), 1))

    @property
    def floor(self) -> float:
        """RMS floor of the force, N."""
        return float(np.sqrt(np.mean(self.floors[:3] ** 2)))
