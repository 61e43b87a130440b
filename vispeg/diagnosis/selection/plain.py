"""Forward selection with backward deletion over any evidence: fitted on some recordings, accepted on others.

Every channel can use it; the tests of a trial are the common ones (`selection.accept`). Joints and contact have
searches of their own that use more knowledge of their evidence.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import stats

from vispeg.core.effect import REGISTRY, Effect, EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.intervals import of_form, widened
from vispeg.diagnosis.conclusion.rivals import compared
from vispeg.diagnosis.conclusion.shows_from import Tried, shows_from
from vispeg.diagnosis.findings import Rivals, Score, Trial
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.schema import ShowsFrom
from vispeg.diagnosis.selection.accept import ranked
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.loop import Loop
from vispeg.diagnosis.selection.shown import Shown
from vispeg.diagnosis.selection.state import State
from vispeg.diagnosis.selection.tries import End, recalled
from vispeg.identify.fit import Fit, fit_job
from vispeg.identify.pool import Submit
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World

ROUNDING = 1e-9  # share of the squared residual within which sums of one model differ


class PlainSearch(Loop, Shown):
    """The loop over one evidence, fitted and held out.

    Args:
        evidence, judged: fitted and held-out.
        say: called with progress messages.
        progress: caches the result of each fit.
    """

    asks = "plain"  # prefix of its questions in the stored progress

    def __init__(
        self,
        evidence: Any,
        judged: Any,
        say: Callable[[str], None] = lambda _: None,
        progress: Progress | None = None,
    ):
        self.evidence, self.judged, self.say = evidence, judged, say
        self.progress = Progress() if progress is None else progress
        self.judge = Judge(judged)

    @property
    def least_share(self) -> float:
        """Share of what an accepted effect typically removed (`State.scale`) that a later one must remove."""
        return RULES.later

    def targets(self, kind: Effect) -> list[str]:
        """Return the places of an effect."""
        return kind.targets(self.evidence.items[0].robot)

    def places(self, world: World) -> list[tuple[str, str]]:
        """Return every effect that the evidence can show, at every place where the world does not have it yet."""
        have = {(e.effect, e.where) for e in world.effects}
        kinds = [(name, kind) for name, kind in sorted(REGISTRY.items()) if self.evidence.sees(kind)]
        places = [(name, t) for name, kind in kinds if (name, "all") not in have for t in self.targets(kind)]
        return [at for at in places if at not in have]

    def start(self, world: World, n_fixed: int | None = None) -> State:
        """Return the state at which a search begins; effects of `world` after the first `n_fixed` are refitted."""
        loss, n_fixed = self.judge.losses([world])[0], len(world.effects) if n_fixed is None else n_fixed
        state = State(world, loss, self.evidence.residuals([world])[0], n_fixed, first=self.judge.mean(loss))
        if state.added:
            (fit,) = self.fits([world], n_fixed)
            state.take(fit, self.judge.losses([fit.world])[0])
            state.opened = fit.world
        return state

    def offers(self, state: State) -> list[Trial]:
        """Return the trials of `step`."""
        trials = self.step(state)
        state.screening = [t.score for t in trials]
        return trials

    def settle(self, state: State, trial: Trial) -> None:
        """Remove effects that the added one made superfluous."""
        self._prune(state)

    def take(self, state: State, trial: Trial, trials: list[Trial]) -> None:
        """Add the effects of a trial, one of `trials`."""
        self.say(f"{trial.score.label}: {self.judged.errors([trial.fit.world])[0]:.3g} {self.judged.unit} left")
        state.steps.append((trial, trials))
        state.take(trial.fit, trial.loss)

    def scored(self, state: State, places: Sequence[tuple[str, str]] | None = None) -> list[Score]:
        """Score the effects of places, by default all, when added to a state; best first.

        A score is the drop of the squared residual that secants over typical sizes predict, beyond what the state's
        effects can do. Nothing is fitted.
        """
        places = self.places(state.world) if places is None else places
        asked = [(where, [*self._secants(*where).values()]) for where in places]
        worlds = [state.world.add(e) for _, tries in asked for e in tries]
        rows = iter(self.evidence.each_residual(worlds))
        fitted = np.zeros((len(state.residual), 0)) if state.fit is None else state.fit.jacobian
        basis = np.linalg.qr(fitted)[0]
        base = state.residual - basis @ (basis.T @ state.residual)
        out = []
        for (name, where), tries in asked:
            columns = np.stack([next(rows) - state.residual for _ in tries], axis=1)
            columns -= basis @ (basis.T @ columns)
            unexplained = base - columns @ np.linalg.lstsq(columns, base, rcond=1e-6)[0]
            out.append(Score(self._start(name, where), float(base @ base - unexplained @ unexplained)))
        return sorted(out, key=lambda s: -s.gain)

    def shows_from(self, state: State) -> list[ShowsFrom]:
        """Return for each effect that a state lacks the values of its magnitudes that these recordings do not show."""

        def tried() -> Iterator[tuple[list[Tried], np.ndarray]]:
            for at in self.shown_at(state.world):
                secants = self._secants(*at)
                worlds = [state.world.add(e) for e in secants.values()]
                columns = np.stack([state.residual - r for r in self.evidence.residuals(worlds)], axis=1)
                both = zip(secants.items(), worlds, strict=True)
                yield [Tried(e, name, self.least_times(e, w, state.world)) for (name, e), w in both], columns

        return shows_from(self, state, tried)

    def shown_at(self, world: World) -> list[tuple[str, str]]:
        """Return the places covered by `shows_from`, including those that no step would try."""
        return PlainSearch.places(self, world)

    def least_times(self, placed: EffectInstance, world: World, without: World) -> float:
        """Return the least multiple of an effect's size that may be named; a smaller one is not, even if detectable.

        The effect, at size 1, is what `world` has in addition to the world `without`.
        """
        return 0.0

    def tested(self, state: State) -> int:
        """Return the number of places that share the significance level of a test."""
        return len(self.places(state.world))

    def step(self, state: State, places: Sequence[tuple[str, str]] | None = None) -> list[Trial]:
        """Fit the best of the places' effects beside the accepted ones and judge them; those that pass come first.

        Places where an effect cannot lower the fitted error, beyond rounding, do not share the level of the test.
        """
        least = ROUNDING * float(state.residual @ state.residual)
        scores = [s for s in self.scored(state, places) if s.gain > least]
        return self.try_all(state, scores[: RULES.fitted], len(scores))

    def try_all(self, state: State, scores: Sequence[Score], tested: int) -> list[Trial]:
        """Fit each score's effect in addition to the accepted ones and judge all; those that pass come first.

        `tested` places share the level of the test.
        """
        if not scores:
            return []
        self.say(f"fitting {', '.join(dict.fromkeys(s.label for s in scores))}")
        fits = self.fits([state.world.add(s.placed) for s in scores], state.n_fixed)
        losses = self.judge.losses([f.world for f in fits])
        trials = []
        for score, fit, loss in zip(scores, fits, losses, strict=True):
            gain = self.judge.gain(state.loss, loss)
            trials.append(Trial(replace(score, gain=gain.mean * self.judged.count), fit, loss, gain))
        judged = ranked(self, state, trials, tested)  # `Shown` provides what it needs
        out = [replace(t, rejected=t.rejected or self.small(t)) for t in judged]
        return sorted(out, key=lambda t: bool(t.rejected))

    def small(self, trial: Trial) -> str:
        """Return why a trial's effect is too small to be named; "" if it is not."""
        return ""

    def idle(self, placed: EffectInstance, state: State, rest: State) -> bool:
        """Return whether an effect of a state is to be removed for a reason specific to the channel.

        `rest` is the state without it.
        """
        return False

    def fits(self, worlds: Sequence[World], n_fixed: int, evidence: Any = None) -> list[Fit]:
        """Fit all but the first `n_fixed` effects of each world; the results are cached."""
        chosen = self.evidence if evidence is None else evidence
        if not worlds:
            return []
        which = hashlib.sha256(
            chosen.residuals(worlds[:1])[0].tobytes()
        ).hexdigest()  # other evidence has the same worlds
        question = [self.asks, which, [model_text(w) for w in worlds], n_fixed, *map(list, sorted(chosen.held))]

        def job(k: int, ended: End | None) -> Callable[[Submit], Fit]:
            return self.job(chosen, worlds[k], n_fixed, ended)

        return recalled(chosen, self.progress, question, len(worlds), job)

    def job(self, evidence: Any, world: World, n_fixed: int, ended: End | None = None) -> Callable[[Submit], Fit]:
        """Return the job of a fit of all but the first `n_fixed` effects; `ended` as in `fit_job`."""
        return fit_job(evidence, world, range(n_fixed, len(world.effects)), iterations=12, ended=ended)

    def finish(self, state: State) -> World:
        """Return the world of a state after its last step, with intervals that include the error of its form."""
        after, floor = self.judge.mean(state.loss), self.judge.floor(state.world)
        wrong = of_form(self.evidence, state.fit, state.first, after, floor)
        return widened(state.world, range(state.n_fixed, len(state.world.effects)), wrong)

    def rivals(self, state: State) -> list[Rivals]:
        """Return for every accepted effect those that held-out recordings cannot tell from it, all others refitted."""
        out = []
        for placed in state.added:
            reduced = self._without(state, placed)
            places = [p for p in self.places(reduced.world) if p != (placed.effect, placed.where)]
            trials = self.step(reduced, places)
            without = self.judge.mean(reduced.loss)
            out.append(compared(self.judge, state, placed.label, trials, without, remaining=False))
        return out

    def _without(self, state: State, placed: EffectInstance) -> State:
        """Return the state without an effect, the others refitted."""
        world, fit = state.world.without(placed.effect, placed.where), None
        if len(world.effects) > state.n_fixed:
            (fit,) = self.fits([world], state.n_fixed)
            world = fit.world
        loss = self.judge.losses([world])[0]
        residual = self.evidence.residuals([world])[0]
        return State(world, loss, residual, state.n_fixed, fit, state.first, state.steps)

    def _prune(self, state: State) -> None:
        """Remove, one by one, the effects that the others make superfluous."""
        while len(state.added) > 1:
            reduced = [(e, self._without(state, e)) for e in state.added]
            gains = [self.judge.gain(r.loss, state.loss) for _, r in reduced]
            idle = [
                i
                for i, ((e, r), g) in enumerate(zip(reduced, gains, strict=True))
                if g.relative < self.evidence.least_gain or g.z < stats.norm.isf(RULES.level) or self.idle(e, state, r)
            ]
            if not idle:
                return
            placed, best = reduced[min(idle, key=lambda i: gains[i].mean)]
            self.say(f"{placed.label} is not needed any more")
            state.world, state.loss, state.residual, state.fit = best.world, best.loss, best.residual, best.fit

    def _secants(self, name: str, where: str) -> dict[str, EffectInstance]:
        """Return an effect with one magnitude at a typical size and the others at null, by the magnitude's name."""
        kind = effect(name)
        nulls = {k: p.null for k, p in kind.params.items() if not p.shape}
        sizes = {k: p.start for k, p in kind.params.items() if not p.shape and p.start != p.null}
        return {k: EffectInstance.of(name, where, **{**nulls, k: v}) for k, v in sizes.items()}

    def _start(self, name: str, where: str) -> EffectInstance:
        """Return the start of an effect's fit: a typical size."""
        return EffectInstance.of(name, where, **{k: p.start for k, p in effect(name).params.items() if not p.shape})
