"""Decide which effects of an incomplete model may be named, by exchanges in the linear model.

If part of the error stays unexplained, an effect that lowers the error may be an alias of a missing one, or several
together of one that the search did not accept. An effect is certain only if, whichever other candidate replaces it,
its removal costs a visible share of the unexplained error. This is tested twice: on the fitted recordings, and on the
held-out ones with the coefficients of the fitted ones. An uncertain effect stays in the model, marked tentative.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.dictionary import Dictionary
from vispeg.diagnosis.evidence.signatures import at_bound
from vispeg.diagnosis.selection.judge import present
from vispeg.diagnosis.selection.state import State

if TYPE_CHECKING:
    from vispeg.diagnosis.findings import Rivals


@dataclass(frozen=True)
class Ground:
    """Evidence on which exchanges are tested.

    Attributes:
        dictionary: its linear model.
        excess: squared residual above noise at each place: a joint's for the effects in it, that of "" for all others.
    """

    dictionary: Dictionary
    excess: Mapping[str, float]

    def needed(self, k: int) -> float:
        """Return the rise of the squared residual that removal of the entry `k` must cost."""
        return RULES.name_costs * self.left(k)

    def left(self, k: int) -> float:
        """Return the excess at an entry's place."""
        return self.excess.get(self.dictionary.entries[k].placed.where, self.excess[""])


@dataclass(frozen=True)
class Exchange:
    """The linear model's alternatives to an accepted effect.

    Attributes:
        label: of the effect.
        costs: rise of the squared residual without the effect, relative to the excess at its place; the smaller of the
            values on the fitted and on the held-out recordings.
        shaken: labels of the candidates with which the removal costs less than `name_costs`; empty if it does without
            any.
        rivals: candidates, with start values, that make it uncertain or fit nearly as well in its place; best first.
    """

    label: str
    costs: float
    shaken: tuple[str, ...]
    rivals: tuple[EffectInstance, ...]


def exchanges(fitted: Ground, held: Ground) -> list[Exchange]:
    """Return an exchange for each effect of the fit; the held-out ground has the same entries as the fitted one."""
    model = list(fitted.dictionary.fitted)
    beside = fitted.dictionary.gains(model)
    both = _Both(fitted.dictionary, held.dictionary)
    return [_exchange(fitted, held, both, model, k, beside) for k in model]


def doubted(fitted: Ground) -> list[int]:
    """Return the entries of candidates that need a check on the held-out recordings: few of the library."""
    dictionary = fitted.dictionary
    model = list(dictionary.fitted)
    error, beside = dictionary.loss(model)[0], dictionary.gains(model)
    out: set[int] = set()
    for k in model:
        out.update(*_doubts(fitted, model, k, beside, error, dictionary.loss([m for m in model if m != k])[0])[1:])
    return sorted(out)


def _doubts(
    fitted: Ground, model: list[int], k: int, beside: np.ndarray, error: float, without: float
) -> tuple[np.ndarray, list[int], list[int]]:
    """Return gains of all entries in place of `k`, entries confounded with it, and hardly worse replacements."""
    entries = fitted.dictionary.entries
    instead = fitted.dictionary.gains([m for m in model if m != k])
    asked = [c for c in range(len(entries)) if c not in model and not _richer(entries[c].placed, entries[k].placed)]
    asked = [c for c in asked if instead[c] > 0]
    costs = {c: (without - instead[c]) - (error - beside[c]) for c in asked}  # ignoring bounds
    alike = [c for c in asked if costs[c] < max(fitted.needed(k), RULES.name_alike * (without - error))]
    return instead, alike, [c for c in asked if without - instead[c] < _near(fitted, k, error, without)]


def _near(fitted: Ground, k: int, error: float, without: float) -> float:
    """Return the squared residual up to which a candidate in place of `k` is worth a fit."""
    return error + RULES.name_slack * min(fitted.left(k), without - error)


class _Both:
    """Squared residuals of sets of entries, fitted and held out, each computed once."""

    def __init__(self, fitted: Dictionary, held: Dictionary):
        self.fitted, self.held = fitted, held
        self.answers: dict[tuple[int, ...], tuple[float, float]] = {}

    def __call__(self, chosen: list[int]) -> tuple[float, float]:
        key = tuple(chosen)
        if key not in self.answers:
            error, coefficients = self.fitted.loss(chosen)
            self.answers[key] = error, self.held.at(chosen, coefficients)
        return self.answers[key]


def _exchange(fitted: Ground, held: Ground, both: _Both, model: list[int], k: int, beside: np.ndarray) -> Exchange:
    entries, rest = fitted.dictionary.entries, [m for m in model if m != k]
    (error, left_held), (without, without_held) = both(model), both(rest)
    instead, alike, close = _doubts(fitted, model, k, beside, error, without)
    share = min((without - error) / fitted.left(k), (without_held - left_held) / held.left(k))
    alike = alike if share >= RULES.name_costs else []
    shaken = []
    for c in alike:
        (other, other_held), (more, more_held) = both([*rest, c]), both([*model, c])
        weak = other - more < fitted.needed(k)
        if weak or other_held - min(left_held, more_held) < held.needed(k):
            shaken.append(c)
    close = [c for c in close if both([*rest, c])[0] < _near(fitted, k, error, without)]
    better = [c for c in alike if both([*rest, c])[1] < left_held]
    order = sorted({*close, *better, *shaken}, key=lambda c: -instead[c])
    rivals = list({entries[c].key: c for c in reversed(order)}.values())[::-1]  # the best of one candidate's guesses
    placed = tuple(fitted.dictionary.placed([*rest, c])[-1] for c in rivals[: RULES.name_rivals])
    labels = dict.fromkeys(entries[c].placed.label for c in shaken)
    return Exchange(entries[k].placed.label, float(share), tuple(labels), placed)


def open_ended(state: State, n_fixed: int) -> frozenset[str]:
    """Labels of the effects after the first `n_fixed` with a value at its bound, or an interval that includes null.

    A missing effect probably pushes a value to its bound, so such an effect is never named. Neither is an effect that
    removes no visible share of the error.
    """
    out = {e.label for e in state.world.effects[n_fixed:] if e.label in state.slight}
    for index, placed in enumerate(state.world.effects[n_fixed:], n_fixed):
        if at_bound(placed) or (state.fit is not None and not present(state.fit, index)):
            out.add(placed.label)
    return frozenset(out)


def tentative(
    state: State, n_fixed: int, exchanged: Sequence[Exchange], rivals: Sequence[Rivals], *, far: bool = False
) -> frozenset[str]:
    """Labels of the effects after the first `n_fixed` that must not be named.

    An effect is named if no candidate makes it uncertain, or only ones that were fitted in its place and did worse on
    held-out recordings; with a few proven competitors it is named together with them. A model that is `far` from the
    recordings names only effects that remove as much error as remains, because a smaller one may just compensate part
    of the remainder.
    """
    proven = {r.label: {t.score.label for t in r.equals} for r in rivals}
    tried = {r.label: {t.score.label for t in r.tried} for r in rivals}
    by_label = {e.label: e for e in exchanged}
    out = set(open_ended(state, n_fixed))
    for index, placed in enumerate(state.world.effects[n_fixed:], n_fixed):
        label, exchange = placed.label, by_label.get(placed.label)
        equals = proven.get(label, set())
        unsure = exchange is not None and (
            exchange.costs < (RULES.name_costs_far if far else RULES.name_costs)
            or bool(set(exchange.shaken) - tried.get(label, set()))
        )
        if unsure or len(equals) > RULES.name_class or _entangled(state, index):
            out.add(label)
    return frozenset(out)


def _entangled(state: State, index: int) -> bool:
    """Return whether a magnitude is strongly correlated with another effect's; of two that cancel, both are needed."""
    if state.fit is None:
        return False
    kinds = [effect(e.effect) for e in state.fit.world.effects]
    axes = [(i, a.index) for i, a in enumerate(state.fit.space.axes) if a.name in kinds[a.index].magnitudes]
    inside, other = [i for i, k in axes if k == index], [i for i, k in axes if k != index]
    return bool(np.any(np.abs(state.fit.correlation[np.ix_(inside, other)]) > RULES.correlated))


def _richer(candidate: EffectInstance, placed: EffectInstance) -> bool:
    """Return whether a candidate contains the effect as a special case, so that both cannot be present."""
    return placed.effect in effect(candidate.effect).contains and candidate.where == placed.where
