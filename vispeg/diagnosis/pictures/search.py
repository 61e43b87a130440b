"""Forward selection with backward deletion over effects that move a picture: fitted on some views, accepted on others.

The criteria are those of every diagnosis (`diagnosis.accept`); beside them an effect has to move the borders by more
than a look moves them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from vispeg.core.effect import OPTICAL, REGISTRY, EffectInstance, effect
from vispeg.diagnosis.accept import equal, ranked
from vispeg.diagnosis.judge import Judge, present
from vispeg.diagnosis.rivals import Rivals, merely_richer
from vispeg.diagnosis.screen import Score
from vispeg.diagnosis.state import State, Trial
from vispeg.identify.fit import Fit, fit_job
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.sensor import SensorEvidence
from vispeg.identify.pool import run_together
from vispeg.worlds.world import World

Pictured = BorderEvidence | SensorEvidence
LEAST_SHARE = 0.01  # of the squared error that an effect so far removed: what its form leaves is not another effect


class PictureSearch:
    """The loop over one kind of picture evidence, fitted and held out.

    Args:
        evidence, judged: of the views to fit and of those to judge on.
        say: is told what is being done.
    """

    def __init__(self, evidence: Pictured, judged: Pictured, say: Callable[[str], None] = lambda _: None):
        self.evidence, self.judged, self.say = evidence, judged, say
        self.judge = Judge(judged)
        self.least_share = LEAST_SHARE
        self.least = evidence.least_change

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

    def run(self, world: World) -> State:
        """Adds effects until none earns its place on the views to judge on."""
        loss = self.judge.losses([world])[0]
        state = State(world, loss, self.evidence.residuals([world])[0], first=self.judge.mean(loss))
        given = len(world.effects)
        while len(state.world.effects) - given < self.evidence.most_effects:
            trials = self.step(state, given)
            state.screening = [t.score for t in trials]
            if not trials or trials[0].rejected:
                state.last = trials
                break
            best, before = trials[0], state.world.label
            self.say(f"{best.score.label}: {self.judged.error(best.fit.world):.2f} {self.judged.unit} left")
            state.steps.append((best, trials))
            state.take(best.fit, best.loss)
            self._prune(state, given)
            if state.world.label == before:
                break
        return state

    def step(self, state: State, given: int, places: Sequence[tuple[str, str]] | None = None) -> list[Trial]:
        """Fits every place's effect beside what was accepted and judges all; those that pass come first."""
        places = self.places(state.world) if places is None else list(places)
        if not places:
            return []
        worlds = [state.world.add(self._start(name, where)) for name, where in places]
        fits = self.fits(worlds, given)
        losses = self.judge.losses([f.world for f in fits])
        trials = []
        for (name, where), fit, loss in zip(places, fits, losses, strict=True):
            gain = self.judge.gain(state.loss, loss)
            trials.append(Trial(Score(self._start(name, where), gain.mean * self.judged.count), fit, loss, gain))
        out = []
        for t in ranked(self, state, trials, len(places)):  # type: ignore[arg-type]
            size = self.shift(t.fit.world, t.fit.world.effects[-1])
            small = not t.rejected and size < self.least
            changes = f"changes the pictures by {size:.2f} {self.evidence.changes_in}, under {self.least:.2f}"
            why = changes if small else t.rejected
            out.append(replace(t, rejected=why))
        return sorted(out, key=lambda t: bool(t.rejected))

    def fits(self, worlds: Sequence[World], given: int, evidence: Pictured | None = None) -> list[Fit]:
        """Fits everything after the first `given` effects of each world."""
        chosen = self.evidence if evidence is None else evidence
        jobs = [fit_job(chosen, w, range(given, len(w.effects)), iterations=12) for w in worlds]
        return run_together(jobs, chosen.residuals)

    def shift(self, world: World, placed: EffectInstance) -> float:
        """RMS change that one effect of a world makes to the held-out views."""
        return self.judged.change(world, world.without(placed.effect, placed.where))

    def rivals(self, state: State, given: int) -> list[Rivals]:
        """For every accepted effect, what the views to judge on cannot tell from it, the others fitted anew."""
        out = []
        for placed in state.world.effects[given:]:
            reduced = self._without(state, placed, given)
            places = [p for p in self.places(reduced.world) if p != (placed.effect, placed.where)]
            trials = self.step(reduced, given, places)
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

    def _without(self, state: State, placed: EffectInstance, given: int) -> State:
        world, fit = state.world.without(placed.effect, placed.where), None
        if len(world.effects) > given:
            (fit,) = self.fits([world], given)
            world = fit.world
        loss = self.judge.losses([world])[0]
        residual = self.evidence.residuals([world])[0]
        return State(world, loss, residual, fit, state.first, state.steps)

    def _prune(self, state: State, given: int) -> None:
        """Takes out, one by one, what the others have made superfluous."""
        while len(state.world.effects) - given > 1:
            rests = [(e, self._without(state, e, given)) for e in state.world.effects[given:]]
            gains = [self.judge.gain(r.loss, state.loss) for _, r in rests]
            idle = [
                i
                for i, ((e, _), g) in enumerate(zip(rests, gains, strict=True))
                if g.relative < self.evidence.least_gain or g.z < 1.645 or self.shift(state.world, e) < self.least
            ]
            if not idle:
                return
            placed, rest = rests[min(idle, key=lambda i: gains[i].mean)]
            self.say(f"{placed.label} is not needed any more")
            state.world, state.loss, state.residual, state.fit = rest.world, rest.loss, rest.residual, rest.fit

    def _start(self, name: str, where: str) -> EffectInstance:
        """Where a fit of an effect starts: where the alignment put it, or a typical size."""
        for e in self.evidence.settled.effects:
            if (e.effect, e.where) == (name, where):
                return EffectInstance.of(name, where, **{k: v.value for k, v in e.params.items()})
        return EffectInstance.of(name, where, **{k: p.start for k, p in effect(name).params.items() if not p.shape})
