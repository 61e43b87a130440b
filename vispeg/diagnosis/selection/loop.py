"""The loop of every search: each move adds the best candidate that passes the test, or revises, until none does.

Each kind of search is a subclass that says what a step tries, how an effect is fitted, and how it is accepted.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

from vispeg.diagnosis.findings import Trial
from vispeg.diagnosis.selection.state import State
from vispeg.worlds.world import World


class Loop(ABC):
    """Add effects to a state until none passes.

    Attributes:
        evidence: the fitted evidence; it limits the number of effects.
    """

    evidence: Any

    @abstractmethod
    def start(self, world: World, n_fixed: int | None = None) -> State:
        """Return the initial state of a search; effects of `world` after the first `n_fixed` may be refitted.

        If `n_fixed` is None, all are fixed.
        """

    @abstractmethod
    def offers(self, state: State) -> list[Trial]:
        """Return the candidates of a step, fitted and judged; those that pass come first, best first."""

    @abstractmethod
    def take(self, state: State, trial: Trial, trials: list[Trial]) -> None:
        """Add the effects of `trial`, one of `trials`, to the state."""

    def settle(self, state: State, trial: Trial) -> None:
        """Revise a state after the addition of `trial`; by default not at all.

        A search may refine the added effect and remove superfluous ones.
        """

    def bound(self, state: State) -> None:
        """Compute intervals of the fitted effects; by default not at all, as fits give them."""

    def back_to(self, state: State) -> None:
        """Prepare to go on from an earlier state; by default there is nothing to prepare."""

    def announce(self, state: State) -> None:
        """Report the state of the search before a step."""

    def ways(self, state: State) -> Sequence[Callable[[State], bool]]:
        """Return the moves that the search may try at a state, in the order of preference.

        A move is called with the state, may change it, and returns whether it did.
        """
        return (self.advance,) if self.worth_it(state) else ()

    def run(self, world: World, n_fixed: int | None = None) -> State:
        """Return the state at which no further effect passes the test on the held-out recordings.

        Effects of `world` after the first `n_fixed` are refitted; by default all of `world` stays as it is.
        """
        n_fixed = len(world.effects) if n_fixed is None else n_fixed
        state = self.start(world, n_fixed)
        self.go_on(state)
        return state

    def go_on(self, state: State) -> None:
        """Move until no move changes the state."""
        while self.move(state):
            pass

    def move(self, state: State) -> bool:
        """Apply to a state the first move that changes it; return False if none does: the search has ended."""
        return any(way(state) for way in self.ways(state))

    def advance(self, state: State) -> bool:
        """Add the best candidate that passes; return False if none does, or if it was removed again."""
        before = state.world.label
        self.announce(state)
        trials = self.offers(state)
        best = next((t for t in trials if not t.rejected), None)
        if best is None:
            state.last = trials
            return False
        self.take(state, best, trials)
        self.settle(state, best)
        return state.world.label != before  # the added effect may have been removed again

    def worth_it(self, state: State) -> bool:
        """Return whether another effect may be added: fewer were added than the evidence allows."""
        return len(state.added) < self.evidence.most_effects
