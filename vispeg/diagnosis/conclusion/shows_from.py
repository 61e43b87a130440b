"""Minimum detectable sizes of effects that were not found: smaller ones would have gone unnoticed.

A trial puts one magnitude of an effect at some size, the others at null (the value that removes the effect). Its trace
is the change of the whitened residual. `least_sizes` computes from the trace the least multiple of that size that would
pass the tests of a search.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.least_sizes import (
    REACH,
    Needs,
    Trace,
    between,
    distance,
    least_coefficient,
)
from vispeg.diagnosis.evidence.localise import joint_data
from vispeg.diagnosis.evidence.screen import candidates
from vispeg.diagnosis.evidence.signatures import probes
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.schema import ShowsFrom
from vispeg.diagnosis.selection.accept import same_kind
from vispeg.diagnosis.selection.bic import correlations, spectra, time_of
from vispeg.diagnosis.selection.cross import on_held_out
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.search import Search
from vispeg.diagnosis.selection.state import State
from vispeg.worlds.model_file import model_text

STEP = 1.15  # factor by which a multiple is raised until the gain is worth the effect's parameters


@dataclass(frozen=True)
class Tried:
    """One magnitude of an effect at a trial size, the others at null.

    Attributes:
        placed: the effect.
        name: the magnitude.
        least: multiple of the size below which a search rejects the effect, whatever its trace.
    """

    placed: EffectInstance
    name: str
    least: float = 0.0

    @property
    def key(self) -> tuple[str, str, str]:
        """(effect, where, magnitude); several trials may share it."""
        return self.placed.effect, self.placed.where, self.name

    def at(self, times: float) -> EffectInstance:
        """Return the effect at a multiple of the size, within bounds; a magnitude on a log scale keeps its size."""
        param = effect(self.placed.effect).params[self.name]
        if param.scale == "log":
            return self.placed
        value = param.null + times * (self.placed.params[self.name].value - param.null)
        return self.placed.with_values(**{self.name: float(np.clip(value, param.low, param.high))})

    def distance(self, times: float) -> float:
        """Return the distance from null at a multiple of the size; infinite if the multiple is."""
        return distance(self.placed, self.name, times)


class Searched(Protocol):
    """The parts of a search on which the sizes depend that it could have found."""

    evidence: Any
    judge: Judge
    progress: Progress

    @property
    def least_share(self) -> float:
        """Share of what the accepted effects removed that a further one must remove."""
        ...

    def tested(self, state: State) -> int:
        """Return the number of places that share the significance level of a test."""
        ...


def joints_show_from(search: Search, state: State) -> list[ShowsFrom]:
    """Return for each effect that a state lacks the values that joint recordings would not show; the result is stored.

    The trials are the screen's probes, at values estimated from the data. An effect that the data rule out has no row.
    """
    count = float(search.judge.size.sum())
    over = search.judge.excess(state.world, state.loss)
    chance = float(stats.norm.ppf(RULES.power)) * np.sqrt(2.0 / count)  # scatter of a mean square of noise
    # at the noise floor a search does not start unless an effect lifts the error above it
    worth = RULES.at_floor - 1.0 + chance if over <= RULES.at_floor - 1.0 else 0.0
    return shows_from(search, state, lambda: of_joints(search, state), worth)


def of_joints(search: Search, state: State) -> Iterator[tuple[list[Tried], np.ndarray]]:
    """Yield the trials of every candidate in joint recordings, and the columns of its signature as their traces."""
    items = search.evidence.items
    places = candidates(search.evidence, state.world, list(items[0].robot.joints))
    asked = probes(places, items[0], joint_data(search.missing(state.world), items))
    for p, signature in zip(asked, search.each_signature(state.world, state.residual, asked), strict=True):
        yield [Tried(p.variants[k], name) for k, name in enumerate(p.names)], signature.columns


def shows_from(
    search: Searched,
    state: State,
    tried: Callable[[], Iterable[tuple[Sequence[Tried], np.ndarray]]],
    worth: float = 0.0,
) -> list[ShowsFrom]:
    """Return for each tried effect the values of its magnitudes that these recordings would not show.

    The effects are added to the state to first order: on the fitted recordings by the given traces, on the held-out
    ones by a rollout at the least size that the fitted ones would show. Of several trials of one magnitude, the one
    that is hardest to detect counts.

    Args:
        search: search that could have found them.
        state: state to which the effects are added.
        tried: called for each effect's trials, one per magnitude, and the traces (n, k) of all its fitted parameters on
            the fitted recordings, those of the magnitudes first. They are yielded one by one, to save memory.
        worth: drop of the mean squared held-out residual below which a search would not start.
    """

    def work_out() -> list:
        rows: dict[tuple[str, str], dict[str, float | None]] = {}
        for (name, where, parameter), size in _least(search, state, tried(), worth).items():
            rows.setdefault((name, where), {})[parameter] = size if np.isfinite(size) else None
        return [[*key, sizes] for key, sizes in rows.items()]

    # in the key of the stored result, since depth and light of pictures ask about the same world
    which = hashlib.sha256(state.residual.tobytes()).hexdigest()
    rows = search.progress.recall(["shows from", which, model_text(state.world)], work_out)
    return [
        {"effect": name, "where": where, "between": between(name, {k: v or np.inf for k, v in sizes.items()})}
        for name, where, sizes in rows
    ]


def _least(
    search: Searched, state: State, tried: Iterable[tuple[Sequence[Tried], np.ndarray]], worth: float
) -> dict[tuple[str, str, str], float]:
    """Return for each (effect, where, magnitude) the least distance from null at which it is found, or infinity.

    Arguments are as in `shows_from`.
    """
    level = float(stats.norm.isf(RULES.discoveries / max(search.tested(state), 1)))
    trials = []
    for seen in _seen(search, state, tried):
        needs = needed(search, state, seen.tried.placed, worth, level)
        promised = max(seen.tried.least, least_coefficient(seen.trace, seen.trace, needs))
        trials.append((seen, needs, promised, seen.tried.distance(promised)))
    sizes = {seen.tried.key: 0.0 for seen, *_ in trials}
    sizes |= {seen.tried.key: np.inf for seen, _, _, size in trials if not np.isfinite(size)}
    # magnitudes with a trial that no size shows are done
    shown = [(seen, needs, promised) for seen, needs, promised, _ in trials if np.isfinite(sizes[seen.tried.key])]
    for (seen, needs, _), held_out in zip(shown, _held_out(search, state, shown), strict=True):
        t = seen.tried
        times = max(t.least, least_coefficient(seen.trace, held_out, needs))
        while times < REACH[1] and not seen.worth_it(times):
            times *= STEP
        sizes[t.key] = max(sizes[t.key], t.distance(times))
    return sizes


@dataclass(frozen=True)
class _Seen:
    """A trial with its trace on the fitted recordings.

    Attributes:
        tried: the trial.
        trace: what of it the fitted parameters of the model cannot imitate.
        taken: (naxis,) what they imitate: coefficients of the trace along the fit's derivatives.
        worth_it: says whether the gain at a multiple of the size is worth the effect's parameters (`selection.bic`).
    """

    tried: Tried
    trace: Trace
    taken: np.ndarray
    worth_it: Callable[[float], bool]


def _seen(search: Searched, state: State, tried: Iterable[tuple[Sequence[Tried], np.ndarray]]) -> Iterator[_Seen]:
    """Yield each trial with its trace on the fitted recordings."""
    residual, blocks = state.residual, search.evidence.blocks(RULES.block)
    basis, upper = np.linalg.qr(np.zeros((len(residual), 0)) if state.fit is None else state.fit.jacobian)
    worth = _Worth(search.evidence, residual)
    for group, columns in tried:
        columns = columns.astype(float)
        along = basis.T @ columns
        independent = columns - basis @ along
        taken = np.linalg.lstsq(upper, along, rcond=1e-9)[0]
        for k, t in enumerate(group):
            trace = Trace.of(independent[:, k], np.delete(independent, k, axis=1), residual, blocks)
            yield _Seen(t, trace, taken[:, k], worth.test(independent[:, k], len(effect(t.placed.effect).params)))


def _held_out(search: Searched, state: State, shown: Sequence[tuple[_Seen, Needs, float]]) -> Iterator[Trace]:
    """Yield the trace of each trial on the held-out recordings, per unit of its size.

    `shown` has for each trial the multiple of its size at which it is rolled out. What the model's parameters imitated
    on the fitted recordings is subtracted.
    """
    if not shown:
        return
    judge, fit = search.judge, state.fit
    (residual,) = judge.evidence.residuals([state.world])
    none = np.zeros((len(residual), 0))
    slopes = none if fit is None else on_held_out(judge, fit).jacobian
    worlds = [state.world.add(seen.tried.at(promised)) for seen, _, promised in shown]
    for (seen, _, promised), (before, after) in zip(
        shown, judge.evidence.each_pair(state.world, residual, worlds), strict=True
    ):
        scale = 1.0 if seen.tried.at(promised) == seen.tried.placed else promised  # some keep their size (`Tried.at`)
        column = (before - after) / scale - slopes @ seen.taken
        yield Trace.of(column, none, residual, judge.blocks)


def needed(search: Searched, state: State, placed: EffectInstance, worth: float, level: float) -> Needs:
    """Return what an effect added to a state must reach to be accepted (`selection.accept.refusal`).

    `worth` is as in `shows_from`, `level` the required standard errors of its gain.
    """
    count, loss = float(search.judge.size.sum()), float(state.loss.sum())
    share = search.evidence.least_gain  # of `loss` plus the drop
    drop = max(share / (1.0 - share) * loss, worth * count)
    if state.steps:
        drop = max(drop, search.least_share * state.scale * count)
    same = [e for e in state.world.effects if same_kind(e, placed)]
    if same:
        drop = max(drop, RULES.refinement * max(map(state.removed_by, same)) * count)
    return Needs(drop, level, loss)


class _Worth:
    """BIC test of whether a gain in fitted recordings is worth an effect's parameters (`selection.bic`).

    If an effect were present at a multiple of a trial's size, the residual without it would grow by that multiple of
    the trace. So the square and the correlations that BIC needs are polynomials in the multiple, computed once.
    """

    def __init__(self, evidence: Any, residual: np.ndarray):
        self.evidence, self.residual = evidence, residual
        self.spectra = spectra(evidence, residual)
        self.correlations = correlations(self.spectra, self.spectra)

    def test(self, column: np.ndarray, parameters: int) -> Callable[[float], bool]:
        """Return the test of a multiple of a trace (n,), for an effect with so many `parameters`."""
        changed = spectra(self.evidence, column)
        mixed, of_column = correlations(self.spectra, changed), correlations(changed, changed)
        square = max(float(self.residual @ self.residual), 1e-300)
        slope, curve = float(self.residual @ column), float(column @ column)

        def passes(times: float) -> bool:
            parts = zip(self.correlations, mixed, of_column, strict=True)
            time = time_of([a + 2.0 * times * b + times**2 * c for a, b, c in parts])
            n = max(2.0, self.evidence.count / (2.0 * time))
            drop = np.log1p(times * (2.0 * slope + times * curve) / square)
            return bool(n * drop > parameters * np.log(n))

        return passes
