"""What the steps of a search ask of it: so each step is read without the search, and the search without a step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.evidence.localise import MissingTorque
from vispeg.diagnosis.findings import Gain, Score, Trial
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.selection.cross import Cross
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.names import Exchange
from vispeg.diagnosis.selection.state import State
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit, Race
from vispeg.worlds.world import World


class Searching(Protocol):
    """A search over the fitted recordings, with what judges it.

    Attributes:
        judge: what judges.
        cross: losses of the fitted recordings, each predicted from the others.
        progress: remembers answers.
        say: is told what is being done.
        least_share: share of what effects so far removed that a later one must remove.
    """

    judge: Judge
    cross: Cross
    progress: Progress
    say: Callable[[str], None]
    least_share: float

    @property
    def evidence(self) -> Evidence:
        """What is fitted."""
        ...

    @property
    def few(self) -> int:
        """Effects up to which the whole library is screened for rivals in the place of each."""
        ...

    def missing(self, world: World) -> list[MissingTorque]:
        """Missing torque of every fitted segment under a world."""
        ...

    def screened(
        self,
        world: World,
        residual: np.ndarray,
        fit: Fit | None,
        places: Sequence[tuple[str, str]],
        missing: Sequence[MissingTorque],
        groups: Sequence[Sequence[tuple[str, str]]] = (),
        several: bool = False,
    ) -> list[Score]:
        """Scores of places and groups beside a world, best first."""
        ...

    def screened_alone(
        self,
        world: World,
        residual: np.ndarray,
        fit: Fit | None,
        places: Sequence[tuple[str, str]],
        missing: Sequence[MissingTorque],
    ) -> list[Score]:
        """Scores of single places, best first."""
        ...

    def instead(self, state: State, placed: EffectInstance) -> tuple[list[Score], int]:
        """Candidates in the place of an effect that a state is without, and how many were screened."""
        ...

    def exchanges(self, state: State) -> list[Exchange]:
        """Say what each effect costs beside every other candidate, and what may stand in its place."""
        ...

    def tested(self, state: State) -> int:
        """How many places share the level of a test."""
        ...

    def try_all(
        self, state: State, scores: Sequence[Score], n_fixed: int, tested: int, goal: float | None = None
    ) -> list[Trial]:
        """Fit candidates beside a state and judge them."""
        ...

    def try_each(
        self, tries: Sequence[tuple[State, Sequence[Score], int]], n_fixed: int, goal: float | None = None
    ) -> list[list[Trial]]:
        """Do so for several states side by side."""
        ...

    def fits(
        self,
        worlds: Sequence[World],
        n_fixed: int,
        *,
        races: Sequence[Race] | None = None,
        iterations: int = 8,
        columns: Sequence[np.ndarray | None] | None = None,
    ) -> list[Fit]:
        """Fit what is not fixed of each world."""
        ...

    def reduced(
        self, worlds: Sequence[World], n_fixed: int, columns: Sequence[np.ndarray | None] | None = None
    ) -> list[Fit]:
        """Fit worlds that each lack one of the accepted effects."""
        ...

    def take(self, state: State, trial: Trial, trials: list[Trial], n_fixed: int) -> None:
        """Add what a trial tried."""
        ...

    def advance(self, state: State, n_fixed: int) -> bool:
        """Add the effect that earns its place best; False where none does."""
        ...

    def go_on(self, state: State, n_fixed: int) -> None:
        """Add effects until none earns its place."""
        ...

    def worth_it(self, state: State, n_fixed: int) -> bool:
        """Whether another step may be taken."""
        ...

    def shows(self, state: State, trial: Trial) -> bool:
        """Whether what a trial adds is there."""
        ...

    def holds(self, state: State, trial: Trial) -> bool:
        """Whether it shows in the held-out recordings alone."""
        ...

    def refusal(self, state: State, trial: Trial, level: float, absent: bool) -> str:
        """Why a trial may not pass; empty where it may."""
        ...

    def needed(self, state: State, index: int, gain: Gain) -> bool:
        """Whether the held-out recordings want the effect at `index`."""
        ...
