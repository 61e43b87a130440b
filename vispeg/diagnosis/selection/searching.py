"""Interface between a search and its steps, so that each can be read without the other."""

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


class Testing(Protocol):
    """Tests that a trial of a search has to pass.

    Attributes:
        judge: judge on the held-out recordings.
    """

    judge: Judge

    @property
    def evidence(self) -> Evidence:
        """Fitted evidence."""
        ...

    @property
    def least_share(self) -> float:
        """Share of what the accepted effects removed that a later one must remove."""
        ...

    def shows(self, state: State, trial: Trial) -> bool:
        """Return whether the effects of a trial are present."""
        ...

    def holds(self, state: State, trial: Trial) -> bool:
        """Return whether a trial's effects show in the held-out recordings alone."""
        ...

    def refusal(self, state: State, trial: Trial, level: float, absent: bool) -> str:
        """Return why a trial must be refused; "" if it passes."""
        ...

    def needed(self, state: State, index: int, gain: Gain) -> bool:
        """Return whether the held-out recordings need the effect at `index`."""
        ...


class Searching(Testing, Protocol):
    """A search over the fitted recordings, with its judge.

    Attributes:
        cross: losses of the fitted recordings, each predicted from the others.
        progress: caches answers.
        say: called with progress messages.
    """

    cross: Cross
    progress: Progress
    say: Callable[[str], None]

    @property
    def few(self) -> int:
        """Largest number of effects for which the whole library is screened for competitors of each."""
        ...

    def missing(self, world: World) -> list[MissingTorque]:
        """Return the missing torque of every fitted segment under a world."""
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
        """Return the scores of places and groups when added to a world, best first."""
        ...

    def screened_alone(
        self,
        world: World,
        residual: np.ndarray,
        fit: Fit | None,
        places: Sequence[tuple[str, str]],
        missing: Sequence[MissingTorque],
    ) -> list[Score]:
        """Return the scores of single places, best first."""
        ...

    def instead(self, state: State, placed: EffectInstance) -> tuple[list[Score], int]:
        """Return candidate replacements of an effect that a state lacks, and the number screened."""
        ...

    def exchanges(self, state: State) -> list[Exchange]:
        """Return for each effect the cost of its removal given every other candidate, and its possible replacements."""
        ...

    def tested(self, state: State) -> int:
        """Return the number of places that share the level of a test."""
        ...

    def try_all(
        self, state: State, scores: Sequence[Score], n_fixed: int, tested: int, goal: float | None = None
    ) -> list[Trial]:
        """Fit candidates added to a state and judge them."""
        ...

    def try_each(
        self, tries: Sequence[tuple[State, Sequence[Score], int]], n_fixed: int, goal: float | None = None
    ) -> list[list[Trial]]:
        """Fit and judge the candidates of several states in one batch."""
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
        """Fit all effects of each world that are not fixed."""
        ...

    def reduced(
        self, worlds: Sequence[World], n_fixed: int, columns: Sequence[np.ndarray | None] | None = None
    ) -> list[Fit]:
        """Fit worlds that each lack one of the accepted effects."""
        ...

    def take(self, state: State, trial: Trial, trials: list[Trial], n_fixed: int) -> None:
        """Add the effects of a trial."""
        ...

    def advance(self, state: State, n_fixed: int) -> bool:
        """Add the best candidate that passes; return False if none does."""
        ...

    def go_on(self, state: State, n_fixed: int) -> None:
        """Add effects until none passes."""
        ...

    def worth_it(self, state: State, n_fixed: int) -> bool:
        """Return whether another step may be taken."""
        ...
