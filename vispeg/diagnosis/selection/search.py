"""Forward selection with backward deletion: fit on some recordings, accept on others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.rivals import replaced
from vispeg.diagnosis.evidence.localise import MissingTorque, joint_z
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
        return begun(self, world, n_fixed)

    def announce(self, state: State) -> None:
        """Report the model and its held-out error."""
        self.say(f"{state.world.label}: held-out {floors(self.judge.mean(state.loss))} x noise; screening")

    def settle(self, state: State, trial: Trial) -> None:
        """Replace a single effect by a richer one if that is better, then remove superfluous effects."""
        if not trial.score.beside:
            grow(self, state, trial.score.placed)
        prune(self, state)

    def worth_it(self, state: State) -> bool:
        """Return whether an addition is allowed, and enough error is left above the floor for a candidate to pass."""
        excess = self.judge.mean(state.loss) - self.judge.floor(state.world)
        enough = excess > RULES.at_floor - 1.0 and (state.fit is None or excess > self.least_share * state.scale)
        return enough and not state.within_noise and super().worth_it(state)

    def offers(self, state: State) -> list[Trial]:
        """Screen the library against the state, fit and judge the best candidates; those that pass come first.

        The candidates are tried in this order. A group is one kind of effect that every arm has, in all joints. A
        trial that passed is sound if not all of its effects ended at a bound (`accept.sound`).

        1. In the first step only, the set of effects that the torques propose. If it passes, no groups are tried.
        2. Effects of the joints that miss most torque (`suspects`) and at all places that are no joints; also groups,
           if there are several such joints. With groups, and in all later steps, also several linear effects at once.
        3. If nothing passed, or only candidates at a bound: pairs of distant effects in the joint that misses most,
           unless 2 included groups.
        4. Groups, if neither 1 passed nor 2 included them: one light joint with a large error may hide the others. They
           are left out if a sound candidate passed and this is a later step, or in the first step leaves only noise.
        5. If nothing passed, effects of the other joints, whose missing torque the first joints may hide. The places
           of 2 count as tested too.
        """
        missing = self.missing(state.world)
        near, others, common = self.places(state, missing)
        state.screening = []
        proposed = self._try_proposed(state, len(near)) if state.fit is None else []
        if passes(proposed):
            common = []
        several = bool(common) or state.fit is not None
        trials = self.try_places(state, near, missing, len(near), common, several)
        trials = in_order(self.judge, state, trials + proposed) if proposed else trials
        if not passes(trials):
            scores = [] if common else pairs(self, state, missing)[: RULES.fitted]
            trials = self.try_all(state, scores, len(near)) + trials
        later = [] if common or passes(proposed) else self._common_groups(state)
        if later and not (
            passes(trials) and (state.fit is not None or self._at_floor(trials[0].fit.world, trials[0].loss))
        ):
            trials += self.try_places(state, [], missing, len(near), later, not several)
            trials = in_order(self.judge, state, trials)
        if others and all(t.rejected for t in trials):
            trials = self.try_places(state, others, missing, len(near) + len(others)) + trials
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
        return self.judge.mean(loss) - self.judge.floor(world) <= RULES.at_floor - 1.0

    def scored(self, state: State) -> list[Score]:
        """Return the candidates for a state, best first by the predicted drop of the fitted error."""
        missing = self.missing(state.world)
        near, _, common = self.places(state, missing)
        return self.screened(state.world, state.residual, state.fit, near, missing, common)

    def tested(self, state: State) -> int:
        """Return the number of places that share the level of the test of one addition to a state."""
        near, others, _ = self.places(state, self.missing(state.world))
        return len(near) + len(others)

    def places(
        self, state: State, missing: Sequence[MissingTorque]
    ) -> tuple[list[tuple[str, str]], list[tuple[str, str]], list[list[tuple[str, str]]]]:
        """Return (effect, place) of the candidates to try first and of the others, and groups to try with the first.

        The first are those of the suspected joints; of all joints where torques are compared.
        """
        joints = list(self.evidence.items[0].robot.joints)
        first = suspects(missing, joints) if self.evidence.unit == "rad" else joints
        near = candidates(self.evidence, state.world, first)
        common = self._common_groups(state) if len(first) > 1 else []
        others = [p for p in candidates(self.evidence, state.world, joints) if p not in near]
        return near, others, common

    def _common_groups(self, state: State) -> list[list[tuple[str, str]]]:
        """Return the groups of effects that every arm has in every joint, without kinds that a step added as one."""
        added = [best.score for best, _ in state.steps if len({e.where for e in best.score.members}) > 1]
        done = {effect(e.effect).common for score in added for e in score.beside}
        return groups(self.evidence, state.world, done)

    def try_places(
        self,
        state: State,
        places: Sequence[tuple[str, str]],
        missing: Sequence[MissingTorque],
        tested: int,
        groups: Sequence[Sequence[tuple[str, str]]] = (),
        several: bool = False,
    ) -> list[Trial]:
        """Screen these places and groups, fit and judge those that promise enough; those that pass come first.

        A group is fitted only if no effect alone promises nearly as much.

        Args:
            state: to which effects are added.
            places, missing, groups, several: as in `screened`.
            tested: number of places that share the level of the test.
        """
        scores = self.screened(state.world, state.residual, state.fit, places, missing, groups, several)
        best_alone = max((s.gain for s in scores if not s.beside), default=0.0)
        scores = [s for s in scores if not s.beside or best_alone < (1.0 - RULES.tie) * s.gain]
        state.screening += scores
        need = self.least_drop(state)
        if not scores or scores[0].gain / self.evidence.count < RULES.promise * need:
            return []
        short = scores[: RULES.fitted]
        trials = self.try_all(state, short, tested)
        fitted = {s.placed.where for s in short if not s.beside}
        elsewhere = [s for s in scores if s not in short and s.key[1] not in fitted]
        elsewhere = [s for s in elsewhere if s.gain / self.evidence.count >= RULES.promise * need]
        if elsewhere and all(t.rejected for t in trials):  # confounded candidates at one place may have filled the list
            trials = trials + self.try_all(state, elsewhere[: RULES.fitted], tested)
            trials.sort(key=lambda t: bool(t.rejected))
        return trials

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
        state.cross = self.cross.loss_of(fit, fit.residual)


def suspects(missing: Sequence[MissingTorque], joints: list[str]) -> list[str]:
    """Return the joints with a visible share of the missing torque: an effect in a joint causes it in that joint."""
    squared = joint_z(missing) ** 2
    order = np.argsort(-squared)
    keep = [j for j in order[: RULES.suspects] if squared[j] > RULES.suspect * squared.max()]
    return [joints[j] for j in sorted(keep)]
