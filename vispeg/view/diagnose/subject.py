"""What a diagnosis compares, as the page needs it: the search that adds effects, and what is drawn of where it stands.

One class each for joints, contact and pictures; the page itself knows only this face.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Protocol

import mujoco
import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.beginning import Beginning
from vispeg.diagnosis.findings import Score, Trial
from vispeg.diagnosis.selection.state import State
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import compiled
from vispeg.view.diagnose.standing import Field, Track
from vispeg.worlds.world import World

BINS = 12  # of a map over time
Say = Callable[[str], None]


class Steps(Protocol):
    """What every search of a diagnosis offers to one who goes step by step."""

    def start(self, world: World, n_fixed: int) -> State:
        """Where a search for what a world lacks begins; its effects after the first `n_fixed` are fitted anew."""
        ...

    def worth_it(self, state: State, n_fixed: int) -> bool:
        """Whether another step may be taken."""
        ...

    def advance(self, state: State, n_fixed: int) -> bool:
        """Add the effect that earns its place best; False where none does."""
        ...

    def scored(self, state: State) -> list[Score]:
        """Give the candidates, best first by what each promises."""
        ...

    def tested(self, state: State) -> int:
        """How many candidates share the level of a test."""
        ...

    def try_all(self, state: State, scores: Sequence[Score], n_fixed: int, tested: int) -> list[Trial]:
        """Fits candidates and judges them."""
        ...

    def take(self, state: State, trial: Trial, trials: list[Trial], n_fixed: int) -> None:
        """Add what a trial tried."""
        ...


class Subject(ABC):
    """Recordings beside a model, by one kind of evidence.

    Attributes:
        search: adds effects; None where there is no recording to judge on.
        columns, units: what is compared side by side: joints, axes of the wrist, cameras; the unit of each.
        unit, floor: of the error in a word; RMS of the noise in it.
        shows: what a cell of the maps says.
    """

    search: Steps | None
    columns: tuple[str, ...]
    units: tuple[str, ...]
    unit: str
    shows: str

    @property
    @abstractmethod
    def floor(self) -> float:
        """RMS of the noise."""

    @property
    @abstractmethod
    def body(self) -> RobotModel | Scene:
        """The arm or cell that effects have places in."""

    def begin(self, world: World) -> Beginning:
        """Give the model before its search."""
        return Beginning(world, len(world.effects))

    @property
    def model(self) -> mujoco.MjModel:
        """The same, to be drawn."""
        return compiled(self.body)

    @abstractmethod
    def error(self, world: World) -> float:
        """RMS error on the recordings that judge."""

    @abstractmethod
    def tracks(self, first: World, now: World) -> tuple[Track, ...]:
        """Give what was measured, and what two worlds predict."""

    @abstractmethod
    def maps(self, first: World, now: World) -> dict[str, Field]:
        """Where two worlds fail."""

    @abstractmethod
    def recorded(self, track: int) -> tuple[Recording, float]:
        """Give the recording of a track, and when the track begins in it, s."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Whose angles a track's posture holds."""
        return tuple(self.body.joints)

    @property
    def cell(self) -> bool:
        """Whether effects have places in a cell."""
        return isinstance(self.body, Scene)

    def parse(self, text: str) -> list[EffectInstance]:
        """Effects from `NAME:WHERE[:param=number,...]`."""
        from vispeg.worlds.words import parse

        return parse(text, self.body)


def field(
    edges: np.ndarray,
    cell: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
    moment: np.ndarray,
    labels: tuple[str, ...] = (),
) -> Field:
    """Give a map of readings.

    Args:
        edges: (k+1,) of its cells.
        cell: (n,) cell of each row of readings; below 0 for none.
        before, after: (n, columns) in units of the noise; NaN where there is no reading.
        moment: (n, 2) track and time, s, of each row.
        labels: (k,) of the cells, where they are no range.
    """
    k, columns = len(edges) - 1, before.shape[1]
    first, now, at = np.full((columns, k), np.nan), np.full((columns, k), np.nan), np.full((columns, k, 2), np.nan)
    for j in range(columns):
        for i in range(k):
            rows = np.flatnonzero((cell == i) & np.isfinite(after[:, j]) & np.isfinite(before[:, j]))
            if rows.size:
                first[j, i], now[j, i] = (np.sqrt(np.mean(v[rows, j] ** 2)) for v in (before, after))
                at[j, i] = moment[rows[np.argmax(np.abs(after[rows, j]))]]
    return Field(edges, first, now, at, labels)


def over_time(before: np.ndarray, after: np.ndarray, moment: np.ndarray) -> Field:
    """Give the same readings over time."""
    time = moment[:, 1]
    edges = np.linspace(float(time.min()), float(time.max()) + 1e-9, BINS + 1)
    return field(edges, np.clip(np.digitize(time, edges) - 1, 0, BINS - 1), before, after, moment)
