"""What the diagnosis page needs of a channel: a search for effects, and data to draw its state.

Joints, contact and pictures have a class each, and `Plain` serves other channels; the page uses only this interface.
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

BINS = 12  # number of cells of a map over time
Say = Callable[[str], None]


class Steps(Protocol):
    """The interface of a search that is driven move by move."""

    def start(self, world: World, n_fixed: int) -> State:
        """Return the state at the start of a search; the world's effects after the first `n_fixed` are fitted again."""
        ...

    def back_to(self, state: State) -> None:
        """Prepare to go on from an earlier state."""
        ...

    def worth_it(self, state: State) -> bool:
        """Return whether another effect may be added."""
        ...

    def move(self, state: State) -> bool:
        """Add, exchange or remove effects; return False if nothing improves the state: the search has ended."""
        ...

    def scored(self, state: State) -> list[Score]:
        """Return the candidates, the one with the largest expected gain first."""
        ...

    def tested(self, state: State) -> int:
        """Return the number of candidates that share the significance level of a test."""
        ...

    def try_all(self, state: State, scores: Sequence[Score], tested: int) -> list[Trial]:
        """Fit candidates and judge each on the held-out recordings."""
        ...

    def take(self, state: State, trial: Trial, trials: list[Trial]) -> None:
        """Add the effects of a trial to the state."""
        ...

    def bound(self, state: State) -> None:
        """Compute the intervals that a search computes only at its end."""
        ...


class Subject(ABC):
    """The comparison of a model with recordings in one channel.

    Attributes:
        search: the search for effects; None without recordings to judge on.
        columns, units: names of the compared quantities (joints, axes of the wrist, cameras), and the unit of each.
        unit: unit of `error` and `floor`.
        shows: what the numbers in the maps mean.
    """

    search: Steps | None
    columns: tuple[str, ...]
    units: tuple[str, ...]
    unit: str
    shows: str

    @property
    @abstractmethod
    def floor(self) -> float:
        """RMS noise, in `unit`."""

    @property
    @abstractmethod
    def body(self) -> RobotModel | Scene:
        """The arm, or the arm in its cell, whose joints, links and parts effects act on."""

    def begin(self, world: World) -> Beginning:
        """Return the model before its search: here, with all its effects fixed."""
        return Beginning(world, len(world.effects))

    def unsearched(self, first: World, now: World) -> tuple[EffectInstance, ...]:
        """Return the effects that the command finds without a search, once the search led from `first` to `now`."""
        return ()

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model of `body`, to be drawn."""
        return compiled(self.body)

    @abstractmethod
    def error(self, world: World) -> float:
        """Return the RMS error on the judged recordings, in `unit`."""

    @abstractmethod
    def tracks(self, first: World, now: World) -> tuple[Track, ...]:
        """Return the measured signals, and the predictions of the given world and of the present one."""

    @abstractmethod
    def maps(self, first: World, now: World) -> dict[str, Field]:
        """Return maps of the errors of the given world and of the present one, axis -> map."""

    @abstractmethod
    def recorded(self, track: int) -> tuple[Recording, float]:
        """Return a track's recording, and the recording's time (s) at the track's zero."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints in a track's posture."""
        return tuple(self.body.joints)

    @property
    def cell(self) -> bool:
        """Return whether the body includes a cell."""
        return isinstance(self.body, Scene)

    def parse(self, text: str) -> list[EffectInstance]:
        """Parse effects from `NAME:WHERE[:param=number,...]`."""
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
    """Return a map of errors over one axis.

    Args:
        edges: (k+1,) edges of the cells.
        cell: (n,) cell number of each row; negative for none.
        before, after: (n, columns) errors as multiples of the noise; NaN without a reading.
        moment: (n, 2) track and time (s) of each row.
        labels: (k,) names of the cells, if they are not ranges of a number.
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
    """Return a map of errors over time, in `BINS` equal cells; arguments as for `field`."""
    time = moment[:, 1]
    edges = np.linspace(float(time.min()), float(time.max()) + 1e-9, BINS + 1)
    return field(edges, np.clip(np.digitize(time, edges) - 1, 0, BINS - 1), before, after, moment)
