"""The search among what moves borders: a name has to be borne out by a second recording, and to be needed as a set."""

from __future__ import annotations

from dataclasses import replace

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.diagnosis.pictures.agreement import agreement
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.judge import parameters, present
from vispeg.diagnosis.selection.state import State, Trial
from vispeg.worlds.world import World

OF_TIME = ("camera_delay", "rolling_shutter")


class BorderSearch(PictureSearch):
    """A search whose names do what no other effects can do, alike in both recordings."""

    @property
    def least_share(self) -> float:
        """As `PictureSearch`: projections are nearly exact, and pixels count (`Agreement`)."""
        return RULES.later

    def run(self, world: World, n_fixed: int | None = None) -> State:
        """Add effects until none earns its place; then let what does as well with less take the place of others."""
        n_fixed = len(world.effects) if n_fixed is None else n_fixed
        state = super().run(world, n_fixed)
        for _ in range(RULES.exchanges):
            better = self._simpler(state, n_fixed) or self._exchange(state, n_fixed)
            if better is None:
                break
            trial, trials = better
            self.take(state, trial, trials, n_fixed)
            self._prune(state, n_fixed)
            self.go_on(state, n_fixed)
        return state

    def doubt(self, placed: EffectInstance, added: World, without: World, n_fixed: int) -> str:
        """As `PictureSearch`: others can do it, or the recordings differ on what it does."""
        return agreement(self, added, without, n_fixed).doubt(self.least_of(placed))

    def least_of(self, placed: EffectInstance) -> float:
        """As `PictureSearch`: what only motion makes is not made by a look."""
        return RULES.moving_px if placed.effect in OF_TIME else self.least

    def _simpler(self, state: State, n_fixed: int) -> tuple[Trial, list[Trial]] | None:
        """One effect alone that does as well as all that were taken."""
        if len(state.world.effects) - n_fixed < 2:
            return None
        trials, base = state.steps[0][1], replace(state.world, effects=state.world.effects[:n_fixed])
        alone = [t for t in trials if not t.rejected and present(t.fit, -1) and equal(self.judge, t.loss, state.loss)]
        alone = [t for t in alone if not self.doubt(t.score.placed, t.fit.world, base, n_fixed)]
        alone.sort(key=lambda t: (parameters(t.fit.world), float(t.loss.sum())))
        return (alone[0], trials) if alone else None

    def _exchange(self, state: State, n_fixed: int) -> tuple[Trial, list[Trial]] | None:
        """Give an effect in whose place another one does better, all else fitted anew."""
        best, chosen = (1.0 - RULES.exchange) * float(state.loss.sum()), state.world.effects[n_fixed:]
        replacement = None
        for placed in chosen if len(chosen) > 1 else ():
            reduced = self._without(state, placed, n_fixed)
            places = [p for p in self.places(reduced.world) if p != (placed.effect, placed.where)]
            trials = self.questioned(reduced, self.step(reduced, n_fixed, places), n_fixed)
            if trials and not trials[0].rejected and float(trials[0].loss.sum()) < best:
                best, replacement = float(trials[0].loss.sum()), (trials[0], trials)
        return replacement
