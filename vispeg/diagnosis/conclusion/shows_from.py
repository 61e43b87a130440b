"""From which size on an effect that was not found would have been: what `adequate` cannot rule out."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.least_sizes import REACH, Needs, Trace, between, distance, least_coefficient
from vispeg.diagnosis.evidence.localise import joint_data
from vispeg.diagnosis.evidence.screen import candidates
from vispeg.diagnosis.evidence.signatures import probes
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.schema import ShowsFrom
from vispeg.diagnosis.selection.accept import same_kind
from vispeg.diagnosis.selection.bic import correlation_time
from vispeg.diagnosis.selection.cross import on_held_out
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.search import Search
from vispeg.diagnosis.selection.state import State
from vispeg.worlds.model_file import model_text

STEP = 1.15  # by which a size grows until its gain is worth its parameters


@dataclass(frozen=True)
class Tried:
    """One magnitude of an effect at a size, the others absent, and what it does to the fitted recordings.

    Attributes:
        placed: the effect.
        name: the magnitude.
        columns: (n, k) the traces, whitened, of all that a fit of the effect moves; `index` is of the magnitude's own.
        least: multiple of the size below which a search does not take it, whatever its trace.
    """

    placed: EffectInstance
    name: str
    columns: np.ndarray
    index: int
    least: float = 0.0

    @property
    def column(self) -> np.ndarray:
        """The trace of the magnitude, (n,), whitened."""
        return self.columns[:, self.index]

    @property
    def others(self) -> np.ndarray:
        """The traces of what else a fit of the effect moves, (n, k - 1); made anew, as there are many trials."""
        return np.delete(self.columns, self.index, axis=1)

    def at(self, times: float) -> EffectInstance:
        """Give the effect at a multiple of the size; a logarithmic one as it is, for no line leads from null to it."""
        param = effect(self.placed.effect).params[self.name]
        if param.scale == "log":
            return self.placed
        value = param.null + times * (self.placed.params[self.name].value - param.null)
        return self.placed.with_values(**{self.name: float(np.clip(value, param.low, param.high))})


class Searched(Protocol):
    """A search, as far as it is asked what it could have found."""

    evidence: Any
    judge: Judge
    progress: Progress

    @property
    def least_share(self) -> float:
        """Share of what the effects so far removed that a later one must remove."""
        ...

    def tested(self, state: State) -> int:
        """How many places share the level of the test."""
        ...


def joints_show_from(search: Search, state: State) -> list[ShowsFrom]:
    """Give the values of every magnitude that recordings of joints do not show beside a state; remembered.

    By the signatures of the screen, taken at the values that the data suggest; an effect that they rule out has no row.
    """

    def tried() -> list[Tried]:
        items = search.evidence.items
        places = candidates(search.evidence, state.world, list(items[0].robot.joints))
        asked = probes(places, items[0], joint_data(search.missing(state.world), items))
        out = []
        for s, p in zip(search.signatures_of(state.world, state.residual, asked), asked, strict=True):
            for k, name in enumerate(p.names):
                out.append(Tried(p.variants[k], name, s.columns, k))
        return out

    count = float(search.judge.size.sum())
    over = float(state.loss.sum()) / count - search.judge.floor(state.world)
    chance = float(stats.norm.ppf(RULES.power)) * np.sqrt(2.0 / count)  # of the mean square of so many readings' noise
    return shows_from(search, state, tried, RULES.at_floor - 1.0 + chance if over <= RULES.at_floor - 1.0 else 0.0)


def shows_from(
    search: Searched, state: State, tried: Callable[[], Sequence[Tried]], worth: float = 0.0
) -> list[ShowsFrom]:
    """For each effect that is tried beside a state, the values of its magnitudes that these recordings do not show.

    To first order beside the state: in the fitted recordings by the trace of each, in the held-out ones by that of the
    size that the former promise. Of several trials of one magnitude the one that shows last counts. `worth` is the drop
    of the mean squared held-out residual below which a search does not begin.
    """

    def work_out() -> list:
        least: dict[tuple[str, str], dict[str, float]] = {}
        every = list(tried())
        for t, times in zip(every, _least(search, state, every, worth), strict=True):
            sizes = least.setdefault((t.placed.effect, t.placed.where), {})
            sizes[t.name] = max(sizes.get(t.name, 0.0), distance(t.placed, t.name, times))
        return [[*key, {k: v if np.isfinite(v) else None for k, v in sizes.items()}] for key, sizes in least.items()]

    which = hashlib.sha256(state.residual.tobytes()).hexdigest()  # depth and light ask alike
    rows = search.progress.recall(["shows from", which, model_text(state.world)], work_out)
    return [
        {"effect": name, "where": where, "between": between(name, {k: v or np.inf for k, v in sizes.items()})}
        for name, where, sizes in rows
    ]


def _least(search: Searched, state: State, tried: Sequence[Tried], worth: float) -> list[float]:
    """Give the least multiple of each trial's size that is found; infinite where none is."""
    fit, residual = state.fit, state.residual
    slopes = np.zeros((len(residual), 0)) if fit is None else fit.jacobian
    basis, upper = np.linalg.qr(slopes)
    blocks, held_blocks = search.evidence.blocks(RULES.block), search.judge.blocks

    def fitted(t: Tried) -> Trace:
        own = [c - basis @ (basis.T @ c) for c in (t.column.astype(float), t.others.astype(float))]
        return Trace.of(own[0], own[1], residual, blocks)

    traces = [fitted(t) for t in tried]
    level = float(stats.norm.isf(RULES.discoveries / max(search.tested(state), 1)))
    needs = [_needs(search, state, t.placed, worth, level) for t in tried]
    promised = [max(t.least, least_coefficient(a, a, n)) for t, a, n in zip(tried, traces, needs, strict=True)]
    out = [np.inf] * len(tried)
    shown = [k for k, times in enumerate(promised) if np.isfinite(distance(tried[k].placed, tried[k].name, times))]
    if not shown:
        return out
    judged = search.judge.evidence
    (held,) = judged.residuals([state.world])
    slopes_held = np.zeros((len(held), 0)) if fit is None else on_held_out(search.judge, fit).jacobian
    moved = iter(judged.each_residual([state.world.add(tried[k].at(promised[k])) for k in shown]))
    for k in shown:
        t, scale = tried[k], 1.0 if tried[k].at(2.0) == tried[k].placed else promised[k]
        taken = np.linalg.lstsq(upper, basis.T @ t.column, rcond=1e-9)[0]  # by the fitted recordings, as of any fit
        column = (held - next(moved)) / scale - slopes_held @ taken
        trace = Trace.of(column, np.zeros((len(held), 0)), held, held_blocks)
        out[k] = max(t.least, least_coefficient(traces[k], trace, needs[k]))
        while out[k] < REACH[1] and not _worth_it(search, state, t, out[k]):
            out[k] *= STEP
    return out


def _needs(search: Searched, state: State, placed: EffectInstance, worth: float, level: float) -> Needs:
    """Give what a search asks for before it accepts an effect beside a state (`selection.accept.refusal`)."""
    count, loss = float(search.judge.size.sum()), float(state.loss.sum())
    share = search.evidence.least_gain
    drop = max(share / (1.0 - share) * loss, worth * count)
    if state.steps:
        drop = max(drop, search.least_share * state.scale * count)
    same = [e for e in state.world.effects if same_kind(e, placed)]
    if same:
        drop = max(drop, RULES.refinement * max(map(state.removed_by, same)) * count)
    return Needs(drop, level, loss)


def _worth_it(search: Searched, state: State, t: Tried, times: float) -> bool:
    """Whether the gain of an effect in the fitted recordings is worth its parameters (`selection.bic`)."""
    before = state.residual + times * t.column
    n = max(2.0, search.evidence.count / (2.0 * correlation_time(search.evidence, before)))
    more = len(effect(t.placed.effect).params)
    drop = np.log(float(before @ before) / float(state.residual @ state.residual))
    return bool(n * drop > more * np.log(n))
