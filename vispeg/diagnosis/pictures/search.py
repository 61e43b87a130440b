"""Search effects by images: each must change them by more than an error of appearance does, and be confirmed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vispeg.core.effect import OPTICAL, Effect, EffectInstance
from vispeg.diagnosis.findings import Score, Trial
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.selection.plain import PlainSearch
from vispeg.diagnosis.selection.state import State
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.sensor import SensorEvidence
from vispeg.worlds.world import World

Pictured = BorderEvidence | SensorEvidence


class PictureSearch(PlainSearch):
    """The search loop over one kind of image evidence; arguments as for `PlainSearch`."""

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

    def targets(self, kind: Effect) -> list[str]:
        """Return the places of an effect; for an optical one, the cameras of the recordings."""
        cameras = dict.fromkeys(i.sight.camera.name for i in self.evidence.items)
        return [*cameras] if kind.family in OPTICAL else kind.targets(self.evidence.scene)

    def offers(self, state: State) -> list[Trial]:
        """Return the trials of `step`, doubted ones after the first that is not."""
        trials = self.questioned(state, self.step(state))
        state.screening = [t.score for t in trials]
        return trials

    def questioned(self, state: State, trials: list[Trial]) -> list[Trial]:
        """Question the trials in order; those found doubtful are moved behind the first that is not."""
        doubted = []
        for t in trials:
            why = t.rejected or self.doubt(t.score.placed, t.fit.world, state.world, state.n_fixed)
            if not why:
                break
            doubted.append(replace(t, rejected=why))
        return [*trials[len(doubted) :], *doubted]

    def doubt(self, placed: EffectInstance, added: World, without: World, n_fixed: int) -> str:
        """Return why the effect that `added` has and `without` lacks must not be named, or "" if it may."""
        return ""

    def least_of(self, placed: EffectInstance) -> float:
        """Return the smallest change of the images, in `evidence.changes_in`, for which an effect is named."""
        return self.least

    def least_times(self, placed: EffectInstance, world: World, without: World) -> float:
        """Return the multiple of the effect that changes the images just enough to be named."""
        changed = self.judged.change(world, without)
        return self.least_of(placed) / changed if changed > 0 else np.inf

    def step(self, state: State, places: Sequence[tuple[str, str]] | None = None) -> list[Trial]:
        """Fit and judge as `PlainSearch` does, but every place, as predicting images is fast."""
        places = self.places(state.world) if places is None else list(places)
        return self.try_all(state, [Score(self._start(*at), 0.0) for at in places], len(places))

    def small(self, trial: Trial) -> str:
        """Return why an effect is too small, or "": it changes the images by less than an error of appearance does."""
        size, least = self.shift(trial.fit.world, trial.fit.world.effects[-1]), self.least_of(trial.score.placed)
        return (
            f"changes the pictures by {size:.2f} {self.evidence.changes_in}, under {least:.2f}" if size < least else ""
        )

    def idle(self, placed: EffectInstance, state: State, rest: State) -> bool:
        """Return whether an effect is to be removed: it changes the images too little, or is doubted."""
        little = self.shift(state.world, placed) < self.least_of(placed)
        return little or bool(self.doubt(placed, state.world, rest.world, state.n_fixed))

    def shift(self, world: World, placed: EffectInstance) -> float:
        """Return the RMS change of the held-out images due to one effect of a world."""
        return self.judged.change(world, world.without(placed.effect, placed.where))

    def _start(self, name: str, where: str) -> EffectInstance:
        """Return the start of an effect's fit: the value found by the alignment, or a typical size."""
        for e in self.evidence.settled.effects:
            if (e.effect, e.where) == (name, where):
                return EffectInstance.of(name, where, **{k: v.value for k, v in e.params.items()})
        return super()._start(name, where)
