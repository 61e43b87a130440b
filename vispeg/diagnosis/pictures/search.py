"""The search among effects that move a picture: by more than a look moves it, and beyond doubt."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vispeg.core.effect import OPTICAL, Effect, EffectInstance
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.screen import Score
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.selection.plain import PlainSearch
from vispeg.diagnosis.selection.state import State, Trial
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.sensor import SensorEvidence
from vispeg.worlds.world import World

Pictured = BorderEvidence | SensorEvidence


class PictureSearch(PlainSearch):
    """The loop over one kind of picture evidence; the arguments of `PlainSearch`."""

    asks = "pictures"
    evidence: Pictured
    judged: Pictured

    def __init__(
        self,
        evidence: Pictured,
        judged: Pictured,
        say: Callable[[str], None] = lambda _: None,
        progress: Progress | None = None,
    ):
        super().__init__(evidence, judged, say, progress)
        self.least = evidence.least_change

    @property
    def least_share(self) -> float:
        """As `PlainSearch`."""
        return RULES.later_pictures

    def targets(self, kind: Effect) -> list[str]:
        """Give the places of an effect: of an optical one the cameras that took the pictures."""
        cameras = dict.fromkeys(i.sight.camera.name for i in self.evidence.items)
        return [*cameras] if kind.family in OPTICAL else kind.targets(self.evidence.scene)

    def offers(self, state: State, n_fixed: int) -> list[Trial]:
        """Give what `step` tries, what is doubted behind what is not."""
        trials = self.questioned(state, self.step(state, n_fixed), n_fixed)
        state.screening = [t.score for t in trials]
        return trials

    def questioned(self, state: State, trials: list[Trial], n_fixed: int) -> list[Trial]:
        """Give the trials, those that pass and are doubted after all behind the first that is not."""
        doubted = []
        for t in trials:
            why = t.rejected or self.doubt(t.score.placed, t.fit.world, state.world, n_fixed)
            if not why:
                break
            doubted.append(replace(t, rejected=why))
        return [*trials[len(doubted) :], *doubted]

    def doubt(self, placed: EffectInstance, added: World, without: World, n_fixed: int) -> str:
        """Why an effect that one of two fitted worlds has more than the other is no name, "" where it is one."""
        return ""

    def least_of(self, placed: EffectInstance) -> float:
        """By how much an effect has to change the pictures."""
        return self.least

    def least_times(self, placed: EffectInstance, world: World, without: World) -> float:
        """As `PlainSearch`: it has to change pictures enough."""
        changed = self.judged.change(world, without)
        return self.least_of(placed) / changed if changed > 0 else np.inf

    def step(self, state: State, n_fixed: int, places: Sequence[tuple[str, str]] | None = None) -> list[Trial]:
        """As `PlainSearch`, every place fitted: pictures are predicted in a moment."""
        places = self.places(state.world) if places is None else list(places)
        return self.try_all(state, [Score(self._start(*at), 0.0) for at in places], n_fixed, len(places))

    def error(self, world: World) -> float:
        """As `PlainSearch`."""
        return self.judged.error(world)

    def small(self, trial: Trial) -> str:
        """As `PlainSearch`: what changes the pictures less than a look does."""
        size, least = self.shift(trial.fit.world, trial.fit.world.effects[-1]), self.least_of(trial.score.placed)
        return (
            f"changes the pictures by {size:.2f} {self.evidence.changes_in}, under {least:.2f}" if size < least else ""
        )

    def idle(self, placed: EffectInstance, state: State, rest: State, n_fixed: int) -> bool:
        """As `PlainSearch`: it changes too little, or is doubted."""
        little = self.shift(state.world, placed) < self.least_of(placed)
        return little or bool(self.doubt(placed, state.world, rest.world, n_fixed))

    def shift(self, world: World, placed: EffectInstance) -> float:
        """RMS change that one effect of a world makes to the held-out views."""
        return self.judged.change(world, world.without(placed.effect, placed.where))

    def _start(self, name: str, where: str) -> EffectInstance:
        """As `PlainSearch`: where the alignment put it, or a typical size."""
        for e in self.evidence.settled.effects:
            if (e.effect, e.where) == (name, where):
                return EffectInstance.of(name, where, **{k: v.value for k, v in e.params.items()})
        return super()._start(name, where)
