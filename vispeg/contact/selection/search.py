"""Contact search: profile, Gauss-Newton fits of the best effects and their pairs, two likelihood-ratio tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy import stats

from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.selection.form import form
from vispeg.contact.selection.likely import intervals
from vispeg.contact.selection.profile import (
    idle,
    places,
    probed,
    promises,
    strongest,
)
from vispeg.contact.selection.screen import Probe, Screen, chatter
from vispeg.contact.selection.shows_from import least_sizes
from vispeg.contact.selection.spare import remove_uncertain, remove_unneeded, sparse
from vispeg.core.effect import EffectInstance, effect, told_apart_by
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Score, Trial
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.scale import floors
from vispeg.diagnosis.selection.cross import Cross
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.loop import Loop
from vispeg.diagnosis.selection.state import State
from vispeg.diagnosis.selection.tries import begun, fit_all, try_each
from vispeg.identify.fit import Fit, Race
from vispeg.worlds.model_file import model_text, placed_dict
from vispeg.worlds.world import World

SHORT = 4  # iterations of a fit that competes with others
NONE = -1e300  # gain of a size that changes nothing, finite for JSON


class ContactSearch(Loop):
    """A search whose candidates are effects of contact, tool and wrench sensor; see `ContactSearching` for its terms.

    Args:
        evidence: of the fitted recordings.
        judge: on the held-out recordings.
        say: called with progress messages.
        progress: caches answers.

    Attributes:
        given: the model from which the search started.
        n_fixed: number of given effects of a world; None (all) until a search starts.
        lately: latest fits of `reduced` with the present effects, by label.
        screens: the screens so far, by world and free effects.
    """

    evidence: ContactEvidence

    def __init__(
        self,
        evidence: ContactEvidence,
        judge: Judge,
        say: Callable[[str], None] = lambda _: None,
        progress: Progress | None = None,
    ):
        self.evidence, self.judge, self.say = evidence, judge, say
        self.progress, self.cross = progress or Progress(), Cross(Judge(evidence))
        self.given, self.n_fixed = World(), None
        self.lately: dict[str, Fit] = {}
        self.screens: dict[tuple[str, range], Screen] = {}

    @property
    def least(self) -> Mapping[tuple[str, str], Mapping[str, float]]:
        """(effect, place) -> parameter -> minimum detectable size added to the given model; simulated once."""
        return least_sizes(self, self.given)

    def need(self, cost: float = 1.0, count: int = 1) -> float:
        """Return the drop of the squared residual that `count` parameters of an absent effect hardly ever reach.

        It allows for errors that are correlated over some blocks, for larger errors of a worse model, and for choosing
        the best effect of the library (Bonferroni). Source: distribution of the likelihood ratio, Wilks 1938, Annals
        of Mathematical Statistics 9(1).
        """
        library = max(1, len(places(self.evidence, World())))
        return self.beyond(cost, float(stats.chi2.isf(RULES.contact_level / library, count)))

    def needed_beside(self, world: World) -> float:
        """Return the gain required of one parameter added to a world.

        It is lower if the residual is already below the noise floors. A residual above the floors does not raise it,
        because the effect may be what removes that residual.
        """
        (residual,) = self.evidence.residuals([world])
        return self.need(min(1.0, self.evidence.chi2(residual)))

    def beyond(self, cost: float, quantile: float) -> float:
        """Return the drop for a chi-squared `quantile`, if a fit leaves a mean squared whitened residual of `cost`.

        It is at least the roughness of the residual due to contacts that begin and end.
        """
        return max(self.evidence.correlated * self.evidence.variance(cost) * quantile, chatter())

    def start(self, world: World, n_fixed: int | None = None) -> State:
        """Return the state at the start, as for joints; effects after the first `n_fixed` are refitted in screening.

        Parameters that these effects were not fitted with before stay at null.
        """
        self.given, self.n_fixed = world, len(world.effects) if n_fixed is None else n_fixed
        for e in world.effects[self.n_fixed :]:
            kind = effect(e.effect)
            self.evidence.absent |= {(kind.name, k) for k, v in e.params.items() if v.value == kind.params[k].null}
        return begun(self, world, n_fixed)

    def ways(self, state: State) -> Sequence[Callable[[State], bool]]:
        """Return the moves: adding an effect, even at the noise floor, as long as few were added; then the conclusion.

        The floors include errors that a good sensor does not have, so a residual below them may still show an effect.
        """
        return () if state.concluded else (*super().ways(state), self._conclude)

    def announce(self, state: State) -> None:
        """Report the model and its held-out error."""
        self.say(f"{state.world.label}: held-out {floors(self.judge.mean(state.loss))} x noise; screening")

    def _conclude(self, state: State) -> bool:
        """Remove effects that the others make superfluous or that may be absent; return whether any was fitted.

        Intervals are costly here, so they are computed once, for the final effects.
        """
        if state.fit is None:
            return False
        while remove_unneeded(self, state):
            pass
        self.bound(state)
        while remove_uncertain(self, state):
            self.bound(state)
        state.concluded = True
        return True

    def bound(self, state: State) -> None:
        """Compute intervals by profiling the squared residual; refit if a lower minimum is found on the way."""
        fit = state.fit
        if fit is None:
            return
        self.say(f"{fit.world.label}: intervals")
        world, best = intervals(self.evidence, fit)
        if np.any(best != fit.u):
            (fit,) = self.fits([fit.space.at(best)], state.n_fixed, iterations=2)
            world, _ = intervals(self.evidence, fit)
        fit = replace(fit, world=world)
        state.take(fit, self.judge.losses([fit.world])[0])

    def fits(
        self,
        worlds: Sequence[World],
        n_fixed: int,
        *,
        races: Sequence[Race] | None = None,
        iterations: int = 6,
        columns: Sequence[np.ndarray | None] | None = None,
    ) -> list[Fit]:
        """Fit as for joints; candidates that race are fitted in few steps that reuse derivatives of the other effects.

        Other fits reuse none, because contacts begin and end when another effect is added.
        """
        if races is None or columns is None or all(c is None for c in columns):
            columns, iterations = None, min(iterations, 6)
        else:
            iterations = SHORT
        return fit_all(
            self.evidence, self.progress, worlds, n_fixed, races=races, iterations=iterations, columns=columns
        )

    def reduced(
        self, worlds: Sequence[World], n_fixed: int, columns: Sequence[np.ndarray | None] | None = None
    ) -> list[Fit]:
        """Fit as for joints; cached, because the search for competing models reuses the fits of `remove_unneeded`."""
        if any(w.label not in self.lately for w in worlds):
            fits = self.fits(worlds, n_fixed, iterations=5)
            self.lately = dict(zip((w.label for w in worlds), fits, strict=True))
        return [self.lately[w.label] for w in worlds]

    def try_all(self, state: State, scores: Sequence[Score], tested: int, goal: float | None = None) -> list[Trial]:
        """Fit and judge candidates, as `tries.try_each`."""
        return try_each(self, [(state, scores, tested)], goal)[0]

    def offers(self, state: State) -> list[Trial]:
        """Screen the library, fit the best effects and, if none of them reaches the floor, their pairs."""
        scores, tested = self.scored(state), self.tested(state)
        promise = promises(self.probed(state.world, places(self.evidence, state.world)))
        scores = sorted(scores, key=lambda s: -max(s.gain, promise[s.key]))
        scores = [s for s in scores if promise[s.key] >= RULES.promise * self.needed_beside(state.world)]
        if not scores:
            return []
        trials = self.try_all(state, scores[: RULES.contact_fitted], tested)
        best = min(trials, key=lambda t: float(t.loss.sum()))
        if len(trials) < 2 or self.judge.mean(best.loss) < RULES.adequate:
            return trials
        pairs = self.pairs(trials)
        trials = trials + (self.try_all(state, pairs, tested) if pairs else [])
        return sorted(trials, key=lambda t: (bool(t.rejected), float(t.loss.sum())))

    def scored(self, state: State) -> list[Score]:
        """Return the best size of each effect added to a state.

        Parameters without a visible size stay fixed in later fits.
        """
        has = {e.effect for e in state.world.effects}
        probes = self.probed(state.world, places(self.evidence, state.world))
        state.screening = strongest(probes)
        self.evidence.absent = {a for a in self.evidence.absent if a[0] in has} | idle(probes)
        return state.screening

    def tested(self, state: State) -> int:
        """Return the number of effects that are not in the world yet."""
        return len(places(self.evidence, state.world))

    def take(self, state: State, trial: Trial, trials: list[Trial]) -> None:
        """Add the effects of a trial, fitted to convergence, without the parameters that may be absent."""
        state.steps.append((trial.bare, [t.bare for t in trials]))
        self.lately = {}
        fit = trial.fit
        if state.fit is not None:  # the trial was fitted in few steps
            (fit,) = self.fits([fit.world], state.n_fixed)
        fit = sparse(self.evidence, fit, state.n_fixed, lambda w: self.fits([w], state.n_fixed)[0])
        state.take(fit, self.judge.losses([fit.world])[0])
        state.cross, state.concluded = self.cross.loss_of(fit, fit.residual), False

    def remove(self, state: State, fit: Fit, loss: np.ndarray) -> None:
        """Set the state to a fit with one effect fewer, and clear the fits cached with that effect."""
        self.lately = {}
        state.take(fit, loss)
        state.cross = self.cross.loss_of(fit, fit.residual)

    def shows(self, state: State, trial: Trial) -> bool:
        """Return whether a trial lowers the squared residual by more than chance.

        Derivatives are not used, as they vanish where contacts stick.
        """
        drop = float(state.residual @ state.residual - trial.fit.residual @ trial.fit.residual)
        count = len([a for a in trial.fit.space.axes if a.index >= len(trial.fit.world.effects) - trial.score.count])
        least = form(self.evidence.items, state.residual) if state.fit is not None else 0.0
        return drop > max(self.need(trial.fit.cost, count), least)

    def holds(self, state: State, trial: Trial) -> bool:
        """Return whether the gain of one effect shows in the held-out recordings, to which nothing is fitted."""
        least = self.held_form(state.world) if state.fit is not None else 0.0
        return float((state.loss - trial.loss).sum()) > max(self.confirms(self.judge.mean(trial.loss)), least)

    def held_form(self, world: World) -> float:
        """Return `vispeg.contact.selection.form.form` of a world in the held-out recordings."""
        judged = self.judge.evidence
        assert isinstance(judged, ContactEvidence)
        return form(judged.items, judged.residuals([world])[0])

    def confirms(self, cost: float = 1.0) -> float:
        """Return the drop of the held-out squared residual that an absent effect reaches once in 100 times."""
        return self.beyond(cost, float(stats.chi2.isf(2 * RULES.contact_level, 1)))  # one-sided

    def refusal(self, state: State, trial: Trial, level: float, absent: bool) -> str:
        """Return why a trial must be refused, by two likelihood ratios; "" if it passes.

        Contact acts in few blocks, so ranks and shares over all blocks say little. The error of the raw readings,
        before nuisances are removed, must not rise either.
        """
        if absent:
            return "it lowers the squared residual by no more than chance"
        if not self.holds(state, trial):
            return "it does not show in the held-out recordings"
        judged = self.judge.evidence
        assert isinstance(judged, ContactEvidence)
        before, after = judged.as_read(state.world), judged.as_read(trial.fit.world)
        return "the held-out error of the raw readings rises" if after > before else ""

    def pairs(self, trials: Sequence[Trial]) -> list[Score]:
        """Return the pairs of the best effects, each at the value that it had alone."""
        order = sorted(trials, key=lambda t: float(t.loss.sum()))
        return [Score(_fitted(a), a.score.gain, (_fitted(b),)) for a, b in combinations(order, 2)]

    def probed(self, world: World, where: Sequence[tuple[str, str]]) -> list[Probe]:
        """Return the result of `vispeg.contact.selection.profile.probed`, which `progress` stores."""

        def work_out() -> list:
            return [
                [p.placed.effect, p.placed.where, p.name, p.placed.params[p.name].value, max(p.gain, NONE), p.moved]
                for p in probed(self.screen(world), where, self.needed_beside(world))
            ]

        question = ["contact profile", model_text(world), [list(p) for p in where], list(self.free(world))]
        answer = self.progress.recall(question, work_out)  # a step asks twice: for scores, and for what they promise
        return [
            Probe(EffectInstance.of(n, at, **{name: value}), name, gain if gain > NONE else -np.inf, moved)
            for n, at, name, value, gain, moved in answer
        ]

    def screen(self, world: World) -> Screen:
        """Return the screen of a world, which is kept: what is asked again is not simulated again."""
        free = self.free(world)
        key = model_text(world), free
        if key not in self.screens:
            self.screens[key] = Screen(self.evidence, world, free)
        return self.screens[key]

    def free(self, world: World) -> range:
        """Return the indices of the effects added by the search, which screening treats as refitted."""
        n = len(world.effects)
        return range(n if self.n_fixed is None else min(self.n_fixed, n), n)

    def instead(self, state: State, placed: EffectInstance) -> tuple[list[Score], int]:
        """Return the best alternatives to an effect, and the number of all alternatives in the library.

        Considered are the trials that were fitted when the effect was added, and effects nearly confounded with it.
        """
        where = [p for p in places(self.evidence, state.world) if p != (placed.effect, placed.where)]
        beside = {t.score.key for taken, trials in state.steps if taken.score.has(placed) for t in trials}
        near = [p for p in where if p in beside or told_apart_by(p[0], placed.effect)]
        least = RULES.promise * self._gain_of(state.world, placed)
        best = [s for s in strongest(self.probed(state.world, near))[: RULES.contact_fitted] if s.gain > least]
        for s in best:
            self.evidence.absent = self.evidence.absent - lacking(placed, s.placed)
        return best, len(where)

    def _gain_of(self, world: World, placed: EffectInstance) -> float:
        """Return the gain of an effect at its value when added to a world; cached."""

        asked = ["contact gain", model_text(world), placed_dict(placed), list(self.free(world))]
        return self.progress.recall(asked, lambda: self.screen(world).gain(placed))


def _fitted(trial: Trial) -> EffectInstance:
    e = trial.fit.world.effects[-1]
    return EffectInstance.of(e.effect, e.where, **{k: v.value for k, v in e.params.items()})


def lacking(placed: EffectInstance, rival: EffectInstance) -> set[tuple[str, str]]:
    """Return the (effect, parameter) pairs that a competitor must free: it has them, and leaves them at null.

    They are the parameters that `placed` uses, if the two effects are nearly confounded. A screen tries each parameter
    separately, and may free one of one effect and not of the other: a grip compliant along x alone cannot compete with
    a fixture compliant along x and y.
    """
    kind = effect(rival.effect)
    if rival.effect == placed.effect or not told_apart_by(placed.effect, rival.effect):
        return set()
    acts = [k for k, v in placed.params.items() if v.value != effect(placed.effect).params[k].null]
    return {(kind.name, k) for k in acts if k in kind.params and rival.params[k].value == kind.params[k].null}
