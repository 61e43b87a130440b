"""Candidates for a search by linear algebra alone, from signatures: effects to add, and effects to exchange.

A signature is the first-order change of the residual by an effect (`evidence.signatures`); it costs rollouts, so
signatures are kept while the world stays the same, and every answer is stored in the progress.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.evidence.constancy import Change, changes
from vispeg.diagnosis.evidence.dictionary import Dictionary
from vispeg.diagnosis.evidence.localise import MissingTorque, joint_data, missing_torque
from vispeg.diagnosis.evidence.screen import candidates, screen
from vispeg.diagnosis.evidence.signatures import Probe, Signature, each_signature, probes, signatures
from vispeg.diagnosis.findings import Score
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.selection.cross import Cross, on_held_out
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.names import Exchange, Ground, doubted, exchanges
from vispeg.diagnosis.selection.state import State
from vispeg.diagnosis.selection.together import exchanged, together
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World


class Proposals:
    """Candidates from linear algebra over the fitted evidence.

    Attributes:
        evidence: the fitted evidence.
        judge: on the held-out evidence.
        progress: stores the answers.
        cross: cross-fitting on the fitted evidence.
    """

    def __init__(self, evidence: Evidence, judge: Judge, progress: Progress):
        self.evidence, self.judge, self.progress = evidence, judge, progress
        self.cross = Cross(Judge(evidence))
        self._world, self._taken = "", {}  # `_key` of the last world, and signatures relative to it, by probe
        self._whole: dict[str, dict[str, Signature]] = {}  # world -> its signatures, where the whole library has them
        self._alone: dict[str, dict[tuple[str, str], Score | None]] = {}  # world -> scores of places, None without gain

    def missing(self, world: World) -> list[MissingTorque]:
        """Return the missing torque of every fitted item under a world."""
        predicted = self.evidence.simulated([world])
        return [missing_torque(item, y[0]) for item, y in zip(self.evidence.items, predicted, strict=True)]

    def screened(
        self,
        world: World,
        residual: np.ndarray,
        fit: Fit | None,
        places: Sequence[tuple[str, str]],
        missing: Sequence[MissingTorque],
        groups: Sequence[Sequence[tuple[str, str]]] = (),
        several: bool = False,
    ) -> list[Score]:
        """Return the scores of `screen`, and with `several` also that of `together`, best first; stored.

        Args:
            world: to which effects are added.
            residual: its whitened residual.
            fit: of that world; None if nothing is fitted.
            places: (effect, place) to score alone.
            missing: the world's missing torque, from which values of the effects are guessed.
            groups: groups of (effect, place) to score as one.
            several: whether to propose also several linear effects of the whole library at once.
        """

        def work_out() -> list:
            asked = [p for group in groups for p in group] + (self._straight(world) if several else [])
            taken = self.signatures(world, residual, [*places, *asked], missing)
            scores = screen(taken, residual, None if fit is None else fit.jacobian, places, groups)
            if several:
                straight = [s for s in taken if effect(s.probe.effect).straight]
                proposal = together(Dictionary(residual, straight, fit, self.cross.folds), self.evidence.most_effects)
                scores += [] if proposal is None else [proposal]
            scores.sort(key=lambda s: -s.gain)
            return [_stored(s) for s in scores]

        asked = [[list(p) for p in group] for group in (places, *groups)]
        out = [_score(s) for s in self.progress.recall(["screen", self._key(world), asked, several], work_out)]
        alone = {s.key: s for s in out if not s.beside and not s.out}
        self._alone.setdefault(self._key(world), {}).update(dict.fromkeys(places) | alone)
        return out

    def screened_alone(
        self,
        world: World,
        residual: np.ndarray,
        fit: Fit | None,
        places: Sequence[tuple[str, str]],
        missing: Sequence[MissingTorque],
    ) -> list[Score]:
        """Return the scores of single places, best first; scores already known for the same world are reused.

        Arguments are as in `screened`.
        """
        fresh = [p for p in places if p not in self._alone.get(self._key(world), {})]
        if fresh:
            self.screened(world, residual, fit, fresh, missing)
        scores = self._alone[self._key(world)] if places else {}
        return sorted((s for p in places if (s := scores[p]) is not None), key=lambda s: -s.gain)

    def swap(self, state: State) -> Score | None:
        """Return the best exchange of fitted linear effects by the linear model, stored; None without one."""
        world, residual, fit = state.world, state.residual, state.fit

        def work_out() -> list:
            taken = self.signatures(world, residual, self._straight(world), self.missing(world))
            score = exchanged(Dictionary(residual, taken, fit, self.cross.folds))
            return [] if score is None else [_stored(score)]

        return next(map(_score, self.progress.recall(["swap", self._key(world)], work_out)), None)

    def exchanges(self, state: State) -> list[Exchange]:
        """Return the exchange of each fitted effect: what its removal costs, and what may replace it.

        Empty if nothing was fitted. The answer is stored.
        """
        if state.fit is None:
            return []
        fit = state.fit

        def work_out() -> list:
            places = candidates(self.evidence, state.world, list(self.evidence.items[0].robot.joints))
            asked = probes(places, self.evidence.items[0], joint_data(self.missing(state.world), self.evidence.items))
            fitted = self._ground(self.cross.judge, state.world, fit, asked)
            self._whole = {self._world: self._taken}
            # held-out rollouts are costly; the entries of candidates come after those of the fit
            asked = [asked[c - len(fitted.dictionary.fitted)] for c in doubted(fitted)]
            fitted = self._ground(self.cross.judge, state.world, fit, asked)
            results = exchanges(fitted, self._ground(self.judge, state.world, on_held_out(self.judge, fit), asked))
            return [[e.label, e.costs, list(e.shaken), [_plain(r) for r in e.rivals]] for e in results]

        rows = self.progress.recall(["exchanges", self._key(state.world)], work_out)
        return [
            Exchange(label, costs, tuple(shaken), tuple(EffectInstance.of(n, w, **values) for n, w, values in rivals))
            for label, costs, shaken, rivals in rows
        ]

    def _ground(self, judge: Judge, world: World, fit: Fit, asked: Sequence[Probe]) -> Ground:
        """Return the linear model and the excess of a fit on a judge's evidence, with the candidates `asked`.

        `fit` has its residual and derivatives on that evidence.
        """
        fitted = judge.evidence is self.evidence
        taken = (
            self.signatures_of(world, fit.residual, asked)
            if fitted
            else signatures(judge.evidence, world, fit.residual, asked)
        )
        return Ground(Dictionary(fit.residual, taken, fit), excess(judge, world, fit.residual))

    def changes(self, state: State) -> list[Change]:
        """Return effects, after the first `n_fixed`, that vary over time or position; see `evidence.constancy`."""
        if state.fit is None:
            return []
        surplus = excess(self.cross.judge, state.world, state.fit.residual)
        return changes(self.evidence.items, state.fit, state.n_fixed, surplus)

    def signatures(
        self,
        world: World,
        residual: np.ndarray,
        places: Sequence[tuple[str, str]],
        missing: Sequence[MissingTorque],
    ) -> list[Signature]:
        """Return the signatures at these (effect, place), each once, for a world with this residual.

        Values are guessed from the `missing` torque.
        """
        items = self.evidence.items
        asked = probes(list(dict.fromkeys(places)), items[0], joint_data(list(missing), items))
        return self.signatures_of(world, residual, asked)

    def signatures_of(self, world: World, residual: np.ndarray, asked: Sequence[Probe]) -> list[Signature]:
        """Return the signatures of probes on the fitted evidence; those of the last world are kept."""
        self._turn_to(world)
        fresh = {str(_plain(p.placed)): p for p in asked if str(_plain(p.placed)) not in self._taken}
        for key, signature in zip(fresh, signatures(self.evidence, world, residual, [*fresh.values()]), strict=True):
            self._taken[key] = signature
        return [self._taken[str(_plain(p.placed))] for p in asked]

    def each_signature(self, world: World, residual: np.ndarray, asked: Sequence[Probe]) -> Iterator[Signature]:
        """Yield the signatures of probes one by one without keeping them; those kept of other worlds are dropped."""
        self._turn_to(world)
        self._whole = {}
        held = [self._taken.get(str(_plain(p.placed))) for p in asked]
        lacking = [p for p, signature in zip(asked, held, strict=True) if signature is None]
        fresh = each_signature(self.evidence, world, residual, lacking)
        for signature in held:
            yield next(fresh) if signature is None else signature

    def _key(self, world: World) -> str:
        """Return what answers about a world depend on: the world, and the weights of the fitted recordings."""
        return model_text(world) + self.evidence.weights

    def _turn_to(self, world: World) -> None:
        """Drop the signatures of other worlds and weights, except those of the last `exchanges`."""
        text = self._key(world)
        if text != self._world:
            self._world, self._taken = text, self._whole.get(text, {})

    def _straight(self, world: World) -> list[tuple[str, str]]:
        """Return (effect, place) of every linear effect (`Effect.straight`) that a world lacks."""
        everywhere = candidates(self.evidence, world, list(self.evidence.items[0].robot.joints))
        return [(name, where) for name, where in everywhere if effect(name).straight]


def excess(judge: Judge, world: World, residual: np.ndarray) -> dict[str, float]:
    """Return the squared whitened residual above noise in each joint, and in all under "".

    It is at least its scatter by chance: the squares of n readings of unit noise have a standard deviation of sqrt(2n).
    """
    total, count = judge.loss(residual).sum(axis=0), judge.size.sum(axis=0)
    floor, joints = judge.floor(world), judge.evidence.items[0].robot.joints
    over = {joint: (total[j], count[j]) for j, joint in enumerate(joints)} | {"": (total.sum(), count.sum())}
    return {where: float(max(a - floor * n, np.sqrt(2.0 * n), 1.0)) for where, (a, n) in over.items()}


def _stored(score: Score) -> list:
    """Return a score as plain JSON data."""
    return [[_plain(e) for e in score.members], score.gain, [_plain(e) for e in score.out]]


def _score(stored: Sequence) -> Score:
    """Return the score that `_stored` wrote."""
    members, gain, gone = stored
    first, *beside = (EffectInstance.of(name, where, **values) for name, where, values in members)
    return Score(first, gain, tuple(beside), tuple(EffectInstance.of(n, w, **values) for n, w, values in gone))


def _plain(placed: EffectInstance) -> list:
    """Return an effect as plain JSON data."""
    return [placed.effect, placed.where, {k: v.value for k, v in placed.params.items()}]
