"""Search effects by image edges: a second recording must confirm each, and the others must not replace it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Trial
from vispeg.diagnosis.pictures.agreement import agreement
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.judge import parameters, present
from vispeg.diagnosis.selection.state import State
from vispeg.worlds.world import World

OF_TIME = ("camera_delay", "rolling_shutter")  # effects that only motion shows


class BorderSearch(PictureSearch):
    """A search whose effects other effects cannot replace, and that act the same in both recordings."""

    @property
    def least_share(self) -> float:
        """Share as in `PictureSearch`; lower, as projection is nearly exact and `doubt` also demands a change in px."""
        return RULES.later

    def ways(self, state: State, n_fixed: int) -> Sequence[Callable[[State, int], bool]]:
        """Return the moves of `PictureSearch`, then the replacement of effects by simpler or better ones."""
        return (*super().ways(state, n_fixed), self._replace)

    def _replace(self, state: State, n_fixed: int) -> bool:
        """Replace all effects by a simpler one, or one by a better, at most `exchanges` times; return whether so."""
        better = None
        if state.replaced < RULES.exchanges:
            better = self._simpler(state, n_fixed) or self._exchange(state, n_fixed)
        if better is None:
            return False
        self.take(state, *better, n_fixed)
        self._prune(state, n_fixed)
        state.replaced += 1
        return True

    def doubt(self, placed: EffectInstance, added: World, without: World, n_fixed: int) -> str:
        """Return why it must not be named, or "": others can replace it, or the two recordings disagree on it."""
        return agreement(self, added, without, n_fixed).doubt(self.least_of(placed))

    def least_of(self, placed: EffectInstance) -> float:
        """Return the least change; it is less for effects of time, which no error of appearance imitates."""
        return RULES.moving_px if placed.effect in OF_TIME else self.least

    def _simpler(self, state: State, n_fixed: int) -> tuple[Trial, list[Trial]] | None:
        """Return the trial of one effect alone that fits as well as all added ones, and the trials it was chosen from.

        None if there is none. The trials are those of the first step, which each add one effect to the user's model.
        """
        if len(state.world.effects) - n_fixed < 2:
            return None
        trials, base = state.steps[0][1], replace(state.world, effects=state.world.effects[:n_fixed])
        alone = [t for t in trials if not t.rejected and present(t.fit, -1) and equal(self.judge, t.loss, state.loss)]
        alone = [t for t in alone if not self.doubt(t.score.placed, t.fit.world, base, n_fixed)]
        alone.sort(key=lambda t: (parameters(t.fit.world), float(t.loss.sum())))
        return (alone[0], trials) if alone else None

    def _exchange(self, state: State, n_fixed: int) -> tuple[Trial, list[Trial]] | None:
        """Return the best trial that replaces one effect by another, and the trials it was chosen from.

        Everything else is refitted. None if no replacement removes a share `exchange` of the held-out error.
        """
        added = state.world.effects[n_fixed:]
        least, replacement = (1.0 - RULES.exchange) * float(state.loss.sum()), None
        for placed in added if len(added) > 1 else ():
            reduced = self._without(state, placed, n_fixed)
            places = [p for p in self.places(reduced.world) if p != (placed.effect, placed.where)]
            trials = self.questioned(reduced, self.step(reduced, n_fixed, places), n_fixed)
            if trials and not trials[0].rejected and float(trials[0].loss.sum()) < least:
                least, replacement = float(trials[0].loss.sum()), (trials[0], trials)
        return replacement
