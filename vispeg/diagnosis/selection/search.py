"""Forward selection with backward deletion: fit on some recordings, accept on others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.rivals import replaced
from vispeg.diagnosis.evidence.screen import candidates, groups
from vispeg.diagnosis.findings import Score, Trial
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.scale import floors
from vispeg.diagnosis.selection.accept import in_order, passes
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.law import grow, refined
from vispeg.diagnosis.selection.loop import Loop
from vispeg.diagnosis.selection.pairs import pairs
from vispeg.diagnosis.selection.proposals import Proposals
from vispeg.diagnosis.selection.prune import prune
from vispeg.diagnosis.selection.shown import Shown
from vispeg.diagnosis.selection.state import State, without
from vispeg.diagnosis.selection.tries import begun, fit_all, try_each
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit, Race
from vispeg.worlds.world import World


class Search(Loop, Shown, Proposals):
    """The search for missing effects of joints; see `Searching` for its terms.

    Args:
        evidence: of the fitted recordings.
        judge: on the held-out recordings.
        say: called with progress messages.
        progress: caches answers.
        proposed: returns the effects that the torques propose (`vispeg.diagnosis.proposal`); several are one candidate
            of the first step.

    Attributes:
        least_share: see `ShareTesting`.
    """

    def __init__(
        self,
        evidence: Evidence,
        judge: Judge,
        say: Callable[[str], None] = lambda _: None,
        progress: Progress | None = None,
        proposed: Callable[[], Sequence[EffectInstance]] = tuple,
    ):
        super().__init__(evidence, judge, progress or Progress())
        self.say, self.proposed = say, proposed
        self.least_share = RULES.later

    def ways(self, state: State) -> Sequence[Callable[[State], bool]]:
        """Return the moves: adding an effect and revisions, if worth it; then exchanges, and rivals as replacements."""
        moves = (self.advance, partial(refined, self)) if self.worth_it(state) else ()
        return (*moves, self._exchange, self._replace)

    def _exchange(self, state: State) -> bool:
        """Exchange accepted effects for others if both fitted and held-out error fall; return whether they did.

        An exchange adds no effect, so errors of the laws' form do not favour it: it is tried wherever more than noise
        is left, also where no further effect would be added (`worth_it`).
        """
        if state.fit is None or state.within_noise or self._at_floor(state.world, state.loss):
            return False
        score = self.swap(state)
        if score is None:
            return False
        self.say(f"fitting {score.label} in place of {', '.join(e.label for e in score.out)}")
        world = without(state.world, score.out).add(*score.members)
        (fit,) = self.fits([world], state.n_fixed, columns=[state.derivatives(score.out)])
        loss = self.judge.losses([fit.world])[0]
        gain = self.judge.gain(state.loss, loss)
        fitted = 1.0 - float(fit.residual @ fit.residual) / float(state.residual @ state.residual)
        if min(gain.relative, fitted) < RULES.exchange:
            return False
        trial = Trial(score, fit, loss, gain)
        self.take(state, trial, [trial])
        prune(self, state)
        return True

    def _replace(self, state: State) -> bool:
        """Replace an effect by a better rival, as `replaced`."""
        return replaced(self, state)

    def start(self, world: World, n_fixed: int | None = None) -> State:
        """Return the state at which a search begins, as `begun`."""
        state = begun(self, world, n_fixed)
        state.weigh(self.evidence)
        state.cross = self.cross.loss_of(state.fit, state.residual)
        return state

    def back_to(self, state: State) -> None:
        """Give the fitted recordings the weights that they had in an earlier state."""
        self.evidence.widen(state.widened)

    def announce(self, state: State) -> None:
        """Report the model and its held-out error."""
        self.say(f"{state.world.label}: held-out {floors(self.judge.mean(state.loss))} x noise; screening")

    def settle(self, state: State, trial: Trial) -> None:
        """Replace a single effect by a better richer one if more than noise is left; then remove superfluous ones."""
        if not trial.score.beside and not self._at_floor(state.world, state.loss):
            grow(self, state, trial.score.placed)
        prune(self, state)

    def worth_it(self, state: State) -> bool:
        """Return whether an addition is allowed, and enough error is left above the floor for a candidate to pass."""
        excess = self.judge.excess(state.world, state.loss)
        enough = excess > RULES.at_floor - 1.0 and (state.fit is None or excess > self.least_share * state.scale)
        return enough and not state.within_noise and super().worth_it(state)

    def offers(self, state: State) -> list[Trial]:
        """Screen the library against the state, fit and judge the best candidates; those that pass come first.

        1. In the first step, the set of effects that the torques propose, as one candidate.
        2. Effects at all places, if the best promises enough; several linear effects at once and, unless 1 passed,
           groups: one kind of effect that every arm has, in all joints. A group is fitted only if no effect alone
           promises nearly as much.
        3. If nothing passed, or only candidates at a bound (`accept.sound`): pairs of distant effects in the joint that
           misses most.
        """
        missing = self.missing(state.world)
        places = self.places(state.world)
        proposed = self._try_proposed(state, len(places)) if state.fit is None else []
        alone = passes(proposed)
        common = [] if alone else self._common_groups(state)
        scores = self.screened(state.world, state.residual, state.fit, places, missing, common, several=not alone)
        best_alone = max((s.gain for s in scores if not s.beside), default=0.0)
        scores = [s for s in scores if not s.beside or best_alone < (1.0 - RULES.tie) * s.gain]
        state.screening = scores
        promises = bool(scores) and scores[0].gain / self.evidence.count >= RULES.promise * self.least_drop(state)
        trials = self.try_all(state, scores[: RULES.fitted], len(places)) if promises else []
        trials = in_order(self.judge, state, trials + proposed) if proposed else trials
        if not passes(trials):
            trials = self.try_all(state, pairs(self, state, missing)[: RULES.fitted], len(places)) + trials
        return trials

    def _try_proposed(self, state: State, tested: int) -> list[Trial]:
        """Fit and judge the set that the torques propose; [] for a single effect, which is a candidate anyway."""
        proposed = self.proposed()
        if len(proposed) < 2:
            return []
        first, *beside = proposed
        return self.try_all(state, [Score(first, 0.0, tuple(beside))], tested)

    def _at_floor(self, world: World, loss: np.ndarray) -> bool:
        """Return whether the held-out loss of a world is at the noise floor."""
        return self.judge.excess(world, loss) <= RULES.at_floor - 1.0

    def scored(self, state: State) -> list[Score]:
        """Return the candidates for a state, best first by the predicted drop of the fitted error."""
        places, common = self.places(state.world), self._common_groups(state)
        return self.screened(state.world, state.residual, state.fit, places, self.missing(state.world), common)

    def tested(self, state: State) -> int:
        """Return the number of places that share the level of the test of one addition to a state."""
        return len(self.places(state.world))

    def places(self, world: World) -> list[tuple[str, str]]:
        """Return every (effect, place) that a world lacks and the evidence can show."""
        return candidates(self.evidence, world, list(self.evidence.items[0].robot.joints))

    def _common_groups(self, state: State) -> list[list[tuple[str, str]]]:
        """Return the groups of effects that every arm has in every joint, without kinds that a step added as one."""
        added = [best.score for best, _ in state.steps if len({e.where for e in best.score.members}) > 1]
        done = {effect(e.effect).common for score in added for e in score.beside}
        return groups(self.evidence, state.world, done)

    def least_drop(self, state: State) -> float:
        """Return the drop of the fitted mean squared residual that a step needs.

        It is smaller if the fitted recordings have less error than the held-out ones: a drive may saturate for a moment
        in one motion and for seconds in another.
        """
        held, fitted = self.judge.mean(state.loss), float(state.residual @ state.residual) / self.evidence.count
        return max(self.evidence.least_gain * held, self.least_share * state.scale) * min(1.0, fitted / held)

    def try_all(self, state: State, scores: Sequence[Score], tested: int, goal: float | None = None) -> list[Trial]:
        """Fit and judge the candidates of one state, as `tries.try_each`."""
        return try_each(self, [(state, scores, tested)], goal)[0]

    def instead(self, state: State, placed: EffectInstance) -> tuple[list[Score], int]:
        """Return possible replacements of an effect that `state` lacks, best first, and the number screened."""
        joints = self.evidence.items[0].robot.joints
        near = [placed.where] if placed.where in joints else []
        places = [c for c in candidates(self.evidence, state.world, near) if c != (placed.effect, placed.where)]
        scores = self.screened_alone(state.world, state.residual, state.fit, places, self.missing(state.world))
        return scores[: RULES.fitted], len(places)

    def fits(
        self,
        worlds: Sequence[World],
        n_fixed: int,
        *,
        races: Sequence[Race] | None = None,
        iterations: int = 8,
        columns: Sequence[np.ndarray | None] | None = None,
    ) -> list[Fit]:
        """Fit all but the first `n_fixed` effects of each world; arguments are as in `Fitting.fits`."""
        return fit_all(
            self.evidence, self.progress, worlds, n_fixed, races=races, iterations=iterations, columns=columns
        )

    def reduced(
        self, worlds: Sequence[World], n_fixed: int, columns: Sequence[np.ndarray | None] | None = None
    ) -> list[Fit]:
        """Fit worlds that each lack one of the accepted effects."""
        return self.fits(worlds, n_fixed, iterations=5, columns=columns)

    def take(self, state: State, trial: Trial, trials: list[Trial]) -> None:
        """Add the effects of a trial, one of `trials`, to the state."""
        state.steps.append((trial.bare, [t.bare for t in trials]))
        fit, loss = trial.fit, trial.loss
        if state.fit is not None or not fit.converged:  # the trial took earlier effects' derivatives as constant
            (fit,) = self.fits([fit.world], state.n_fixed, iterations=3 if fit.converged else 8)
            loss = self.judge.losses([fit.world])[0]
        state.take(fit, loss)
        state.weigh(self.evidence)
        state.cross = self.cross.loss_of(state.fit, state.residual)
