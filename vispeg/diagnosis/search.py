"""Forward selection with backward deletion: fit on some recordings, accept on others."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance, effect, searchable
from vispeg.diagnosis.bic import bic_gain
from vispeg.diagnosis.judge import Judge, parameters, present
from vispeg.diagnosis.localise import MissingTorque, joint_data, joint_z, missing_torque
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.screen import Score, candidates, screen
from vispeg.diagnosis.state import State, Trial
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit, Race, fit_job
from vispeg.identify.pool import Submit, run_together
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World

BEST = 7  # candidates fitted at each step
AT_FLOOR = 1.25  # held-out noise variances at which there is nothing left to look for
TIE = 0.03  # two fits this close in held-out squared error (above the floor) count as equals
LEAST_SHARE = 0.001  # of what the effects so far typically removed that a later one must remove: no model is exact
CLEAR = 0.8  # share of the held-out squared error that no mere refinement removes
REFINEMENT = 0.03  # of what an effect of the same kind at the same place removed: no model of friction is exact
PROMISE = 0.3  # of the gain that a step needs, which the score test must promise for a fit to be tried
ALPHA = 0.01  # family-wise level of a step, over all places screened (Holm)
# An effect that acts at times (a torque limit), or beside another that is missing too, gains in few blocks of time:
DECISIVE = 0.5  # share of the held-out squared error that chance does not remove, so that blocks need pass at 5 % only


class Search:
    """The discovery loop over fitted evidence and a held-out judge."""

    def __init__(
        self,
        evidence: Evidence,
        judge: Judge,
        say: Callable[[str], None] = lambda _: None,
        progress: Progress | None = None,
    ):
        self.evidence, self.judge, self.say, self.progress = evidence, judge, say, progress or Progress()
        self.least_share = min(LEAST_SHARE, evidence.least_gain)

    def run(self, world: World) -> State:
        """Adds effects until none earns its place on the held-out recordings."""
        residual, loss = self.evidence.residuals([world])[0], self.judge.losses([world])[0]
        state = State(world, loss, residual, first=self.judge.mean(loss))
        state.missing = self.missing(world)
        given = len(world.effects)
        while len(state.world.effects) - given < self.evidence.most_effects and self._worth_it(state):
            self.say(f"{state.world.label}: held-out {self.judge.mean(state.loss):.3f} x noise variance; screening")
            trials = self.step(state, given)
            accepted = [t for t in trials if not t.rejected]
            if not accepted:
                state.last = trials
                break
            best = accepted[0]
            state.steps.append((best, trials))
            self._take(state, best)
            self._grow(state, best.score.placed, given)
            self._delete(state, given)
        return state

    def _worth_it(self, state: State) -> bool:
        """Whether enough is left above the floor for a step to be able to pass."""
        left = self.judge.mean(state.loss) - self.judge.floor(state.world)
        return left > AT_FLOOR - 1.0 and (state.fit is None or left > self.least_share * state.scale)

    def missing(self, world: World) -> list[MissingTorque]:
        """Missing torque of every fitted segment under a world."""
        predicted = self.evidence.simulated([world])
        return [missing_torque(item, y[0]) for item, y in zip(self.evidence.items, predicted, strict=True)]

    def step(self, state: State, given: int) -> list[Trial]:
        """Screens the library against the state, fits the best, judges them; the ones that pass come first.

        The joints that miss most come first, and with them everything that is no joint; the other joints, whose missing
        torque they may hide, only where nothing passes there; then the first places count as tested too.
        """
        missing, everywhere = self.missing(state.world), list(self.evidence.items[0].robot.joints)
        first = suspects(missing, everywhere) if self.evidence.unit == "rad" else everywhere
        near = candidates(self.evidence, state.world, first)
        rest = [p for p in candidates(self.evidence, state.world, everywhere) if p not in near]
        state.screening = []
        trials = self.step_at(state, given, near, missing, len(near))
        if rest and all(t.rejected for t in trials):
            trials = self.step_at(state, given, rest, missing, len(near) + len(rest)) + trials
        return trials

    def step_at(
        self, state: State, given: int, places: Sequence[tuple[str, str]], missing: Sequence[MissingTorque], tested: int
    ) -> list[Trial]:
        """The same at these places alone; `tested` places in all share the level of the test."""
        jac = state.fit.jacobian if state.fit is not None else None
        scores = self.screened(state.world, state.residual, jac, places, missing)
        state.screening += scores
        need = max(self.evidence.least_gain * self.judge.mean(state.loss), self.least_share * state.scale)
        if not scores or scores[0].gain / self.evidence.count < PROMISE * need:
            return []
        short = shortlist(scores, BEST)
        trials = self.try_all(state, short, given, tested)
        seen = {s.key[1] for s in short}
        elsewhere = [s for s in scores if s.key[1] not in seen and s.gain / self.evidence.count >= PROMISE * need]
        if elsewhere and all(t.rejected for t in trials):  # alike candidates at one place may have filled the list
            trials = trials + self.try_all(state, shortlist(elsewhere, BEST), given, tested)
            trials.sort(key=lambda t: bool(t.rejected))
        return trials

    def try_all(self, state: State, scores: Sequence[Score], given: int, tested: int) -> list[Trial]:
        """Fits each score's effect jointly with what was accepted, and judges all on the held-out recordings."""
        worlds = [state.world.add(s.placed) for s in scores]
        self.say(f"fitting {', '.join(s.placed.label for s in scores)}")
        fits = self.fits(worlds, given, race=Race())
        losses = self.judge.losses([f.world for f in fits])
        trials = []
        for s, f, loss in zip(scores, fits, losses, strict=True):
            trials.append(Trial(s, f, loss, self.judge.gain(state.loss, loss)))
        return self._ranked(state, trials, tested)

    def screened(
        self,
        world: World,
        residual: np.ndarray,
        jacobian: np.ndarray | None,
        places: Sequence[tuple[str, str]],
        missing: Sequence[MissingTorque],
    ) -> list[Score]:
        """`screen` for these missing torques, remembered."""

        def work_out() -> list:
            joints = joint_data(list(missing), self.evidence.items)
            scores = screen(self.evidence, world, residual, jacobian, places, joints)
            return [[*s.key, {k: v.value for k, v in s.placed.params.items()}, s.gain] for s in scores]

        found = self.progress.recall(["screen", model_text(world), [list(p) for p in places]], work_out)
        return [Score(EffectInstance.of(name, where, **values), gain) for name, where, values, gain in found]

    def fits(self, worlds: Sequence[World], given: int, *, race: Race | None = None, iterations: int = 8) -> list[Fit]:
        """Fits everything after the first `given` effects of each world; where each ended is remembered."""
        fresh: list[Fit] = []

        def job(world: World, ended: tuple[Sequence[float], bool] | None = None) -> Callable[[Submit], Fit]:
            free = range(given, len(world.effects))
            return fit_job(self.evidence, world, free, race=race, iterations=iterations, ended=ended)

        def work_out() -> list:
            fresh.extend(run_together([job(w) for w in worlds], self.evidence.residuals))
            return [[f.u.tolist(), f.converged] for f in fresh]

        question = ["fits", [model_text(w) for w in worlds], given, race is not None, iterations]
        known = self.progress.recall(question, work_out)
        again = [job(w, (u, bool(c))) for w, (u, c) in zip(worlds, known, strict=True)]
        return fresh or run_together(again, self.evidence.residuals)

    def _ranked(self, state: State, trials: list[Trial], tested: int) -> list[Trial]:
        """Refuses what fails a criterion, and puts the simplest of the equals first."""
        level = float(stats.norm.isf(ALPHA / max(tested, 1)))  # Holm's first and strictest threshold
        out = []
        for t in trials:
            why = ""
            share = t.gain.mean / state.scale
            alike = [e for e in state.world.effects if _alike(e, t.score.placed)]
            beside = max(alike, key=state.removed_by, default=None)
            refines = t.gain.mean / state.removed_by(beside) if beside is not None else 1.0
            if beside is not None and refines < REFINEMENT and t.gain.relative < CLEAR:
                why = f"only refines {beside.label} at the same place ({100 * refines:.2g} % of what that removed)"
            elif share < self.least_share:
                why = f"removes {100 * share:.2g} % of what an effect so far did, under {100 * self.least_share:.1g} %"
            elif t.gain.relative < self.evidence.least_gain:
                why = f"held-out gain {100 * t.gain.relative:.1f} % is under {100 * self.evidence.least_gain:.0f} %"
            elif t.gain.z < (level if t.gain.relative < DECISIVE else stats.norm.isf(0.05)):
                why = f"held-out gain is {t.gain.z:.1f} standard errors, under {level:.1f}"
            elif not present(t.fit, len(t.fit.world.effects) - 1):
                why = "its interval includes no effect"
            elif bic_gain(self.evidence, state.world, state.residual, t.fit) <= 0:
                why = "BIC with the effective sample size does not improve"
            out.append(Trial(t.score, t.fit, t.loss, t.gain, why))
        passed = sorted((t for t in out if not t.rejected), key=lambda t: float(t.loss.sum()))
        if passed:
            best = passed[0]
            equal = [t for t in passed if self.equal(t.loss, best.loss, self.judge.mean(state.loss))]
            first = min(equal, key=lambda t: (parameters(t.fit.world), float(t.loss.sum())))
            passed.remove(first)
            passed.insert(0, first)
        refused = sorted((t for t in out if t.rejected), key=lambda t: float(t.loss.sum()))
        return passed + refused

    def equal(self, loss: np.ndarray, best: np.ndarray, without: float = 1.0) -> bool:
        """Whether held-out data cannot tell a world from a better one: not significantly worse, or hardly worse.

        Hardly is measured on what is left above the floor and on the excess `without` either: no model is exact.
        """
        gain = self.judge.gain(loss, best)
        excess = max(self.judge.mean(best) - 1.0, 0.0)
        return gain.mean <= max(TIE * (excess + 0.3), LEAST_SHARE * (without - 1.0)) or gain.z < 2.0

    def _take(self, state: State, trial: Trial) -> None:
        state.world, state.fit, state.loss, state.residual = trial.fit.world, trial.fit, trial.loss, trial.fit.residual

    def _grow(self, state: State, placed: EffectInstance, given: int) -> None:
        """Puts a richer effect in the place of the one just added, which may have been its shadow: play behind a rotor.

        The richer one's own fit, from afar, is easily caught where the simpler one explains most.
        """
        simple = next(e for e in state.world.effects if (e.effect, e.where) == (placed.effect, placed.where))
        data = joint_data(self.missing(state.world), self.evidence.items)
        starts: list[EffectInstance] = []
        for name, kind in searchable().items():
            for own, its in kind.grows_from.get(simple.effect, {}).items():
                joints = self.evidence.items[0].robot.joints
                for guess in kind.guesses(data[joints.index(simple.where)]) if simple.where in joints else ():
                    start = EffectInstance.of(name, simple.where, **{**guess, own: simple.params[its].value})
                    starts += [start] if start not in starts and self.evidence.sees(kind) else []
        if not starts:
            return
        rest = state.world.without(simple.effect, simple.where)
        fits = self.fits([rest.add(s) for s in starts], given, race=Race())
        losses = self.judge.losses([f.world for f in fits])
        k = int(np.argmin([self.judge.mean(loss) for loss in losses]))
        gain = self.judge.gain(state.loss, losses[k])
        if gain.relative > DECISIVE and gain.z > stats.norm.isf(0.05) and present(fits[k], -1):
            self.say(f"{starts[k].label} stands behind {simple.label}")
            trial = Trial(Score(starts[k], 0.0), fits[k], losses[k], gain)
            state.steps.append((trial, [trial]))
            self._take(state, trial)

    def _delete(self, state: State, given: int) -> None:
        """Backward deletion: drops effects that the later ones made needless."""
        while len(state.world.effects) - given > 1:
            worlds = [state.world.without(e.effect, e.where) for e in state.world.effects[given:-1]]
            fits = self.fits(worlds, given, iterations=5)
            losses = self.judge.losses([f.world for f in fits])
            gains = [self.judge.gain(loss, state.loss) for loss in losses]
            k = int(np.argmin([g.mean for g in gains]))
            if gains[k].relative >= self.evidence.least_gain and gains[k].z >= 2.0:
                return
            self.say(f"{state.world.effects[given + k].label} is no longer needed")
            state.world, state.fit, state.loss, state.residual = fits[k].world, fits[k], losses[k], fits[k].residual


def _alike(a: EffectInstance, b: EffectInstance) -> bool:
    """Two effects of one kind at one joint."""
    return a.where == b.where and effect(a.effect).family == effect(b.effect).family == "joint"


def suspects(missing: list[MissingTorque], joints: list[str], share: float = 0.02, most: int = 4) -> list[str]:
    """Joints with a visible share of the missing torque: an effect in one joint leaves torque missing there."""
    z = joint_z(missing) ** 2
    order = np.argsort(-z)
    keep = [j for j in order[:most] if z[j] > share * z.max()]
    return [joints[j] for j in sorted(keep)]


def shortlist(scores: Sequence[Score], best: int) -> list[Score]:
    """The scores worth a fit: the best, none under a quarter of the greatest gain unless few are left."""
    top = scores[0].gain
    return [s for i, s in enumerate(scores) if i < best and (i < 4 or s.gain > 0.25 * top)]
