"""Decide which effects of an incomplete model may be named, by exchanges in the linear model (`Dictionary`).

If part of the error stays unexplained, an accepted effect may be an alias: it imitates a missing one, alone or together
with others. It is certain only if its removal costs a visible share of the unexplained error, whichever other candidate
is added. This is tested twice: on the fitted recordings, and on the held-out ones with the coefficients of the fitted
ones. An uncertain effect stays in the model, marked tentative.

The functions speak of entries of the dictionary by index: `k` is the effect to remove, `c` a candidate, `model` has
all effects of the fit. `error` is the squared residual of the whole model, `without` that without `k`.
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
    """The fitted or the held-out evidence, on which exchanges are tested.

    Attributes:
        dictionary: its linear model.
        excess: squared residual above noise of each joint, for effects in it; under "" that of all, for other effects.
    """

    dictionary: Dictionary
    excess: Mapping[str, float]

    def needed(self, k: int) -> float:
        """Return the least rise of the squared residual by its removal with which the entry `k` is certain."""
        return RULES.name_costs * self.excess_at(k)

    def excess_at(self, k: int) -> float:
        """Return the excess at the place of the entry `k`."""
        return self.excess.get(self.dictionary.entries[k].placed.where, self.excess[""])


@dataclass(frozen=True)
class Exchange:
    """The linear model's alternatives to an accepted effect.

    Attributes:
        label: of the effect.
        costs: rise of the squared residual by the effect's removal, over the excess at its place; the smaller of the
            values on the fitted and on the held-out recordings.
        shaken: labels of the candidates that make it uncertain: once one of them is in the model, the removal costs
            less than `name_costs`. Not worked out, and empty, if it costs less already.
        rivals: candidates, with start values, that make it uncertain or fit nearly as well in its place; best first.
    """

    label: str
    costs: float
    shaken: tuple[str, ...]
    rivals: tuple[EffectInstance, ...]


def exchanges(fitted: Ground, held: Ground) -> list[Exchange]:
    """Return the exchange of each effect of the fit; `held`, the held-out ground, has the same entries as `fitted`."""
    model = list(fitted.dictionary.fitted)
    beside = fitted.dictionary.gains(model)
    both = _Both(fitted.dictionary, held.dictionary)
    return [_exchange(fitted, held, both, model, k, beside) for k in model]


def doubted(fitted: Ground) -> list[int]:
    """Return the candidates that may make an effect uncertain or replace it; only they need held-out rollouts."""
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
    """Return the gain of every entry in place of `k`, then two lists of candidates, both ignoring bounds.

    With one of the first in the model, the removal of `k` costs little. The others fit nearly as well in its place.
    `beside` is the gain of every entry in addition to the model.
    """
    entries = fitted.dictionary.entries
    instead = fitted.dictionary.gains([m for m in model if m != k])
    asked = [c for c in range(len(entries)) if c not in model and not _richer(entries[c].placed, entries[k].placed)]
    asked = [c for c in asked if instead[c] > 0]
    costs = {c: (without - instead[c]) - (error - beside[c]) for c in asked}  # ignoring bounds
    alike = [c for c in asked if costs[c] < max(fitted.needed(k), RULES.name_alike * (without - error))]
    return instead, alike, [c for c in asked if without - instead[c] < _near(fitted, k, error, without)]


def _near(fitted: Ground, k: int, error: float, without: float) -> float:
    """Return the squared residual up to which a candidate in place of `k` fits nearly as well."""
    return error + RULES.name_costs * min(fitted.excess_at(k), without - error)


class _Both:
    """Squared residuals of a set of entries, (fitted, held out), both with the fitted coefficients; computed once."""

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
    """Return the exchange of the effect `k`.

    `both` gives squared residuals of sets: those with a candidate in place of `k` are `swapped`, with both `added`.
    Names in `_held` are of the held-out ground. `beside` is as in `_doubts`.
    """
    entries, others = fitted.dictionary.entries, [m for m in model if m != k]
    (error, error_held), (without, without_held) = both(model), both(others)
    instead, alike, close = _doubts(fitted, model, k, beside, error, without)
    share = min((without - error) / fitted.excess_at(k), (without_held - error_held) / held.excess_at(k))
    alike = alike if share >= RULES.name_costs else []
    shaken = []
    for c in alike:
        (swapped, swapped_held), (added, added_held) = both([*others, c]), both([*model, c])
        weak = swapped - added < fitted.needed(k)
        if weak or swapped_held - min(error_held, added_held) < held.needed(k):
            shaken.append(c)
    close = [c for c in close if both([*others, c])[0] < _near(fitted, k, error, without)]
    better = [c for c in alike if both([*others, c])[1] < error_held]
    order = sorted({*close, *better, *shaken}, key=lambda c: -instead[c])
    rivals = list({entries[c].key: c for c in reversed(order)}.values())[::-1]  # the best of one candidate's guesses
    placed = tuple(fitted.dictionary.placed([*others, c])[-1] for c in rivals[: RULES.name_class])
    labels = dict.fromkeys(entries[c].placed.label for c in shaken)
    return Exchange(entries[k].placed.label, float(share), tuple(labels), placed)


def never_named(state: State) -> frozenset[str]:
    """Return the labels of added effects that are never named, however well they fit.

    These have a value at its bound, to which a missing effect probably pushes it, are not clearly present (`present`),
    or remove no visible share of the error (`State.slight`).
    """
    out = {e.label for e in state.added if e.label in state.slight}
    for index, placed in enumerate(state.added, state.n_fixed):
        if at_bound(placed) or (state.fit is not None and not present(state.fit, index)):
            out.add(placed.label)
    return frozenset(out)


def tentative(
    state: State, exchanged: Sequence[Exchange], rivals: Sequence[Rivals], *, far: bool = False
) -> frozenset[str]:
    """Return the labels of added effects that must not be named.

    An effect may be named if its removal costs enough (`Exchange.costs`), every candidate that makes it uncertain was
    also fitted in its place, and its values are not strongly correlated with another effect's. If it has equals, it is
    named together with them, unless they are many. In a model that is `far` from the recordings the removal must cost
    about as much error as remains, because an effect that removes less may just compensate part of it.

    Args:
        state: the last of the search.
        exchanged: of the linear model.
        rivals: fitted rivals of the added effects.
        far: whether the model is far from the recordings.
    """
    proven = {r.label: {t.score.label for t in r.equals} for r in rivals}
    tried = {r.label: {t.score.label for t in r.tried} for r in rivals}
    by_label = {e.label: e for e in exchanged}
    out = set(never_named(state))
    for index, placed in enumerate(state.added, state.n_fixed):
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
    """Return whether a magnitude of an effect is strongly correlated with one of another effect in the fit."""
    if state.fit is None:
        return False
    kinds = [effect(e.effect) for e in state.fit.world.effects]
    axes = [(i, a.index) for i, a in enumerate(state.fit.space.axes) if a.name in kinds[a.index].magnitudes]
    inside, other = [i for i, k in axes if k == index], [i for i, k in axes if k != index]
    return bool(np.any(np.abs(state.fit.correlation[np.ix_(inside, other)]) > RULES.correlated))


def _richer(candidate: EffectInstance, placed: EffectInstance) -> bool:
    """Return whether a candidate contains the effect as a special case, so that both cannot be present."""
    return placed.effect in effect(candidate.effect).contains and candidate.where == placed.where
