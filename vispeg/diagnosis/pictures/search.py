"""Forward selection with backward deletion over effects that move a picture: fitted on some views, accepted on others.

The criteria are those of every diagnosis (`diagnosis.accept`); beside them an effect has to move the borders by more
than a look moves them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vispeg.core.effect import OPTICAL, REGISTRY, EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.rivals import Rivals, merely_richer
from vispeg.diagnosis.conclusion.shows_from import Tried, shows_from
from vispeg.diagnosis.evidence.screen import Score
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.schema import ShowsFrom
from vispeg.diagnosis.selection.accept import equal, ranked
from vispeg.diagnosis.selection.judge import Judge, present
from vispeg.diagnosis.selection.loop import Loop
from vispeg.diagnosis.selection.shown import Shown
from vispeg.diagnosis.selection.state import State, Trial
from vispeg.identify.fit import Fit, fit_job
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.sensor import SensorEvidence
from vispeg.identify.pool import run_together
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World

Pictured = BorderEvidence | SensorEvidence


class PictureSearch(Loop[State, Trial], Shown):
    """The loop over one kind of picture evidence, fitted and held out.

    Args:
        evidence, judged: of the views to fit and of those to judge on.
        say: is told what is being done.
        progress: remembers where each fit ended.
    """

    def __init__(
        self,
        evidence: Pictured,
        judged: Pictured,
        say: Callable[[str], None] = lambda _: None,
        progress: Progress | None = None,
    ):
        self.evidence, self.judged, self.say = evidence, judged, say
        self.progress = Progress() if progress is None else progress
        self.judge = Judge(judged)
        self.least = evidence.least_change

    @property
    def least_share(self) -> float:
        """Share of what effects so far removed that a later one must: what a form leaves is not another effect."""
        return RULES.later_pictures

    def places(self, world: World) -> list[tuple[str, str]]:
        """Every effect that the pictures can show, at every place that the world has it not at yet."""
        have = {(e.effect, e.where) for e in world.effects}
        cameras = list(dict.fromkeys(i.sight.camera.name for i in self.evidence.items))
        out = []
        for name, kind in sorted(REGISTRY.items()):
            if self.evidence.sees(kind):
                targets = cameras if kind.family in OPTICAL else kind.targets(self.evidence.scene)
                out += [(name, t) for t in targets if (name, t) not in have and (name, "all") not in have]
        return out

    def start(self, world: World, n_fixed: int | None = None) -> State:
        """Where a search for what `world` lacks begins."""
        loss = self.judge.losses([world])[0]
        return State(world, loss, self.evidence.residuals([world])[0], first=self.judge.mean(loss))

    def offers(self, state: State, n_fixed: int) -> list[Trial]:
        """Give what `step` tries, what is doubted behind what is not."""
        trials = self.questioned(state, self.step(state, n_fixed), n_fixed)
        state.screening = [t.score for t in trials]
        return trials

    def settle(self, state: State, trial: Trial, before: State, n_fixed: int) -> None:
        """Take out what the effect that came in made superfluous."""
        self._prune(state, n_fixed)

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
        """Give the multiple of an effect, which one of two worlds has more than the other, that changes pictures
        enough.
        """
        changed = self.judged.change(world, without)
        return self.least_of(placed) / changed if changed > 0 else np.inf

    def take(self, state: State, trial: Trial, trials: list[Trial], n_fixed: int) -> None:
        """Add what a trial tried, one of `trials`."""
        self.say(f"{trial.score.label}: {self.judged.error(trial.fit.world):.2f} {self.judged.unit} left")
        state.steps.append((trial, trials))
        state.take(trial.fit, trial.loss)

    def scored(self, state: State) -> list[Score]:
        """Every place's effect beside a state, best first by what secants over typical sizes explain of the residual.

        Nothing is fitted, so a score is a promise only: of the part that the effects of the state cannot make.
        """
        asked = [(where, [*self._secants(*where).values()]) for where in self.places(state.world)]
        worlds = [state.world.add(e) for _, tries in asked for e in tries]
        rows = iter(self.evidence.residuals(worlds))
        fitted = np.zeros((len(state.residual), 0)) if state.fit is None else state.fit.jacobian
        basis = np.linalg.qr(fitted)[0]
        base = state.residual - basis @ (basis.T @ state.residual)
        out = []
        for (name, where), tries in asked:
            columns = np.stack([next(rows) - state.residual for _ in tries], axis=1)
            columns -= basis @ (basis.T @ columns)
            rest = base - columns @ np.linalg.lstsq(columns, base, rcond=1e-6)[0]
            out.append(Score(self._start(name, where), float(base @ base - rest @ rest)))
        return sorted(out, key=lambda s: -s.gain)

    def shows_from(self, state: State) -> list[ShowsFrom]:
        """For each effect that a state has not, the values of its magnitudes that these pictures do not show."""

        def tried() -> list[Tried]:
            out = []
            for at in PictureSearch.places(self, state.world):  # also those that no step would try, nothing being odd
                secants = self._secants(*at)
                worlds = [state.world.add(e) for e in secants.values()]
                columns = np.stack([state.residual - r for r in self.evidence.residuals(worlds)], axis=1)
                for k, ((name, placed), world) in enumerate(zip(secants.items(), worlds, strict=True)):
                    out.append(Tried(placed, name, columns, k, self.least_times(placed, world, state.world)))
            return out

        return shows_from(self, state, tried)

    def tested(self, state: State) -> int:
        """How many places share the level of the test where one of them is tried beside a state."""
        return len(self.places(state.world))

    def step(self, state: State, n_fixed: int, places: Sequence[tuple[str, str]] | None = None) -> list[Trial]:
        """Fits every place's effect beside what was accepted and judges all; those that pass come first."""
        places = self.places(state.world) if places is None else list(places)
        return self.try_all(state, [Score(self._start(*at), 0.0) for at in places], n_fixed, len(places))

    def try_all(self, state: State, scores: Sequence[Score], n_fixed: int, tested: int) -> list[Trial]:
        """Fits each score's effect beside what was accepted and judges all; those that pass come first.

        `tested` places share the level of the test.
        """
        if not scores:
            return []
        fits = self.fits([state.world.add(s.placed) for s in scores], n_fixed)
        losses = self.judge.losses([f.world for f in fits])
        trials = []
        for score, fit, loss in zip(scores, fits, losses, strict=True):
            gain = self.judge.gain(state.loss, loss)
            trials.append(Trial(replace(score, gain=gain.mean * self.judged.count), fit, loss, gain))
        out = []
        for t in ranked(self, state, trials, tested):  # type: ignore[arg-type]
            size = self.shift(t.fit.world, t.fit.world.effects[-1])
            least = self.least_of(t.score.placed)
            small = not t.rejected and size < least
            changes = f"changes the pictures by {size:.2f} {self.evidence.changes_in}, under {least:.2f}"
            why = changes if small else t.rejected
            out.append(replace(t, rejected=why))
        return sorted(out, key=lambda t: bool(t.rejected))

    def fits(self, worlds: Sequence[World], n_fixed: int, evidence: Pictured | None = None) -> list[Fit]:
        """Fits everything after the first `n_fixed` effects of each world; where each ended is remembered."""
        chosen, fresh = self.evidence if evidence is None else evidence, list[Fit]()
        if not worlds:
            return []

        def job(world: World, ended: tuple[Sequence[float], bool] | None = None):
            return fit_job(chosen, world, range(n_fixed, len(world.effects)), iterations=12, ended=ended)

        def work_out() -> list:
            fresh.extend(run_together([job(w) for w in worlds], chosen.residuals, length=chosen.length))
            return [[f.u.tolist(), f.converged] for f in fresh]

        which = hashlib.sha256(chosen.residuals(worlds[:1])[0].tobytes()).hexdigest()  # halves and kinds ask alike
        question = ["pictures", which, [model_text(w) for w in worlds], n_fixed, *map(list, sorted(chosen.held))]
        ends = self.progress.recall(question, work_out)
        again = [job(w, (u, bool(c))) for w, (u, c) in zip(worlds, ends, strict=True)]
        return fresh or run_together(again, chosen.residuals, length=chosen.length)

    def shift(self, world: World, placed: EffectInstance) -> float:
        """RMS change that one effect of a world makes to the held-out views."""
        return self.judged.change(world, world.without(placed.effect, placed.where))

    def rivals(self, state: State, n_fixed: int) -> list[Rivals]:
        """For every accepted effect, what the views to judge on cannot tell from it, the others fitted anew."""
        out = []
        for placed in state.world.effects[n_fixed:]:
            reduced = self._without(state, placed, n_fixed)
            places = [p for p in self.places(reduced.world) if p != (placed.effect, placed.where)]
            trials = self.step(reduced, n_fixed, places)
            without = self.judge.mean(reduced.loss)
            equals = [
                t
                for t in trials
                if equal(self.judge, t.loss, state.loss, without)
                and present(t.fit, -1)
                and t.gain.relative > 0
                and not merely_richer(self.judge, t, state, placed.label)
            ]
            out.append(Rivals(placed.label, tuple(equals), tuple(trials)))
        return out

    def _without(self, state: State, placed: EffectInstance, n_fixed: int) -> State:
        world, fit = state.world.without(placed.effect, placed.where), None
        if len(world.effects) > n_fixed:
            (fit,) = self.fits([world], n_fixed)
            world = fit.world
        loss = self.judge.losses([world])[0]
        residual = self.evidence.residuals([world])[0]
        return State(world, loss, residual, fit, state.first, state.steps)

    def _prune(self, state: State, n_fixed: int) -> None:
        """Take out, one by one, what the others have made superfluous."""
        while len(state.world.effects) - n_fixed > 1:
            rests = [(e, self._without(state, e, n_fixed)) for e in state.world.effects[n_fixed:]]
            gains = [self.judge.gain(r.loss, state.loss) for _, r in rests]
            idle = [
                i
                for i, ((e, r), g) in enumerate(zip(rests, gains, strict=True))
                if g.relative < self.evidence.least_gain
                or g.z < RULES.drop_single
                or self.shift(state.world, e) < self.least_of(e)
                or self.doubt(e, state.world, r.world, n_fixed)
            ]
            if not idle:
                return
            placed, rest = rests[min(idle, key=lambda i: gains[i].mean)]
            self.say(f"{placed.label} is not needed any more")
            state.world, state.loss, state.residual, state.fit = rest.world, rest.loss, rest.residual, rest.fit

    def _secants(self, name: str, where: str) -> dict[str, EffectInstance]:
        """Give an effect with one magnitude after the other at a typical size, by that magnitude; the others absent."""
        kind = effect(name)
        rest = {k: p.null for k, p in kind.params.items() if not p.shape}
        sizes = {k: p.start for k, p in kind.params.items() if not p.shape and p.start != p.null}
        return {k: EffectInstance.of(name, where, **{**rest, k: v}) for k, v in sizes.items()}

    def _start(self, name: str, where: str) -> EffectInstance:
        """Where a fit of an effect starts: where the alignment put it, or a typical size."""
        for e in self.evidence.settled.effects:
            if (e.effect, e.where) == (name, where):
                return EffectInstance.of(name, where, **{k: v.value for k, v in e.params.items()})
        return EffectInstance.of(name, where, **{k: p.start for k, p in effect(name).params.items() if not p.shape})
