"""The interface of a search to its steps (`law`, `prune`, `pairs`, ...), so that each can be read without the other.

A place is (effect, where). A score is a candidate with its predicted gain, a trial a candidate fitted and judged. In
all methods the effects of a world after the first `n_fixed` are fitted.
"""

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
    """The part of a search that tests trials.

    Attributes:
        judge: judge on the held-out recordings.
    """

    judge: Judge

    @property
    def evidence(self) -> Evidence:
        """Fitted evidence."""
        ...

    def shows(self, state: State, trial: Trial) -> bool:
        """Return whether an effect that a trial adds is present: its interval excludes null."""
        ...

    def refusal(self, state: State, trial: Trial, level: float, absent: bool) -> str:
        """Return why a trial must be refused; "" if it passes.

        `level` is the required standard errors of its gain, `absent` that none of its effects is present.
        """
        ...


class ShareTesting(Testing, Protocol):
    """The tests of a search in which an effect must remove a share of the error."""

    @property
    def least_share(self) -> float:
        """Share of what an accepted effect typically removed (`State.scale`) that a later one must remove."""
        ...

    def holds(self, state: State, trial: Trial) -> bool:
        """Return whether a trial's effects show in the held-out recordings alone."""
        ...

    def needed(self, state: State, index: int, gain: Gain) -> bool:
        """Return whether the held-out recordings need the effect at `index`, which lowers their error by `gain`."""
        ...


class Fitting(Testing, Protocol):
    """A search that fits candidates on the fitted recordings.

    Attributes:
        cross: losses of the fitted recordings, each predicted from the others.
        progress: caches answers.
        say: called with progress messages.
    """

    cross: Cross
    progress: Progress
    say: Callable[[str], None]

    def instead(self, state: State, placed: EffectInstance) -> tuple[list[Score], int]:
        """Return candidates in place of `placed`, which the state lacks, best first, and the number screened."""
        ...

    def tested(self, state: State) -> int:
        """Return the number of places that share the significance level of a test."""
        ...

    def try_all(self, state: State, scores: Sequence[Score], tested: int, goal: float | None = None) -> list[Trial]:
        """Fit candidates added to a state and judge them; those that pass come first.

        `tested` places share the level of the test. A fit stops if it cannot reach the mean squared residual `goal`.
        """
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
        """Fit each world.

        Args:
            worlds: with start values.
            n_fixed: number of first effects that are not fitted.
            races: for each world the rule by which its fit stops early; None for no such rule.
            iterations: most points that each fit evaluates, the start included.
            columns: for each world derivatives to its first coordinates that an earlier fit had, to be kept; None for
                none.
        """
        ...

    def reduced(
        self, worlds: Sequence[World], n_fixed: int, columns: Sequence[np.ndarray | None] | None = None
    ) -> list[Fit]:
        """Fit worlds that each lack one of the accepted effects; `columns` are as in `fits`."""
        ...


class Searching(Fitting, ShareTesting, Protocol):
    """A search over recordings of joints, with its judge."""

    def missing(self, world: World) -> list[MissingTorque]:
        """Return the missing torque of every fitted item under a world."""
        ...

    def exchanges(self, state: State) -> list[Exchange]:
        """Return for each fitted effect what its removal costs, and what may replace it."""
        ...

    def take(self, state: State, trial: Trial, trials: list[Trial]) -> None:
        """Add the effects of `trial`, one of `trials`, to the state."""
        ...
