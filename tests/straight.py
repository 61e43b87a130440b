"""Contact evidence with errors that a test states: chosen phases and forces, and a residual linear in parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path as Folder

import numpy as np

from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.hand import hand
from vispeg.contact.inputs import ContactItem, Touching
from vispeg.contact.path import Path
from vispeg.contact.phases import Phases
from vispeg.contact.selection.search import ContactSearch
from vispeg.core.effect import effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.selection.judge import Judge
from vispeg.identify.channels import Channel
from vispeg.recordings.recording import Control, Recording
from vispeg.robots.scene import Scene, build
from vispeg.sim.segments.segment import Segment
from vispeg.worlds.world import World

SCENE = build()
DOWN = np.array([0.0, 1, 0, 0])  # of the flange, w x y z


@lru_cache
def held() -> Scene:
    """The hand that holds the cell's part."""
    return hand(SCENE)


def path(place: np.ndarray, origin: np.ndarray, goal: np.ndarray | None = None, step: float = 1e-3) -> Path:
    """A flange that points down, `place` (n, 6) away from `origin`, without a wrench; the goal is the cell's."""
    n = len(place)
    time, zero = np.arange(n) * step, np.zeros((n, 6))
    goal = np.array(SCENE.target) if goal is None else goal
    return Path(step, time, origin, DOWN, place, zero, np.tile(np.eye(6), (n, 1, 1)), zero, goal, np.arange(n), time)


def blocks(
    code: Sequence[int] | np.ndarray,
    used: np.ndarray | None = None,
    contact: np.ndarray | None = None,
    origin: np.ndarray | None = None,
) -> ContactItem:
    """An episode of one sample a block in these phases, all compared but those that are not `used`.

    The flange stands at `origin` and feels `contact` (m, 6) N, N m.
    """
    code = np.asarray(code, int)
    m = len(code)
    way = path(np.zeros((m, 6)), np.zeros(3) if origin is None else origin, step=RULES.contact_block)
    flat, no = np.zeros((m, 3)), np.zeros(m, bool)
    rate = 1.0 / RULES.contact_block
    rec = Recording(
        Folder("blocks"), "iiwa14", SCENE.joints, rate, Control("unknown", rate), way.time, np.zeros((m, 7)),
        ft=np.zeros((m, 6)),
    )  # fmt: skip
    phase = Phases(
        way.time, code, no, slice(0, 0), 1, np.zeros(m), np.zeros((m, 6)) if contact is None else contact, ~no,
        ~no if used is None else used, (slice(0, m),),
    )  # fmt: skip
    sides = tuple(Channel(kind, flat, np.ones((m, 3)), np.ones((m, 3), bool)) for kind in ("force", "moment"))
    wrench, scene = np.zeros((m, 6)), held()
    segment = Segment(rec.control, RULES.contact_block, {}, rec.q, rec.q, rec.q, rec.time, np.arange(m))
    return ContactItem(
        rec, segment, scene, sides, path=way, phase=phase, source=Touching(rec, SCENE, wrench), armless=scene,
        path_response=np.zeros((6, m, 6)), reading_response=np.zeros((m, 6, 6)),
    )  # fmt: skip


class Straight(ContactEvidence):
    """Contact whose residual is a straight line in some parameters of effects, and constant in all others.

    Attributes:
        hidden: (n,) residual of the nominal cell, n a multiple of 6.
        slopes: (effect, parameter) -> drop of the residual (n,) per unit of the parameter's distance from null.
        asked: how often residuals were computed.
    """

    def __init__(self, hidden: np.ndarray, slopes: Mapping[tuple[str, str], np.ndarray]):
        self.hidden, self.slopes, self.asked = hidden, slopes, 0
        self.items = [blocks(np.zeros(len(hidden) // 6, int))]
        self.recordings, self.nthread, self.notes = [self.items[0].recording], 1, []
        self.absent: set[tuple[str, str]] = set()
        self._recent = []

    def each_residual(self, worlds: Sequence[World]) -> Iterator[np.ndarray]:
        """Yield the residual of each world."""
        self.asked += 1
        for world in worlds:
            yield self.residual(world)

    def residual(self, world: World) -> np.ndarray:
        """Return the residual (n,) of a world."""
        out = self.hidden.copy()
        for e in world.effects:
            for name, value in e.params.items():
                if (e.effect, name) in self.slopes:
                    out -= self.slopes[e.effect, name] * (value.value - effect(e.effect).params[name].null)
        return out

    def as_read(self, world: World) -> float:
        """Return the squared residual, without any nuisance."""
        return float(np.sum(self.residual(world) ** 2))


def search(evidence: Straight, judged: Straight | None = None) -> ContactSearch:
    """Return a search for effects in such contact; it is judged on `evidence` itself if `judged` is None."""
    return ContactSearch(evidence, Judge(evidence if judged is None else judged))
