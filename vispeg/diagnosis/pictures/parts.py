"""Find which parts of an effect are present: scale, offset and tilt of a depth error are separate faults.

All parts are free at once in one fit. A set of parts suffices if the fit cannot distinguish the others from null
(Wald, Transactions of the American Mathematical Society 54(3), 1943). Among the smallest such sets the likeliest is
chosen; the others compete with it: at one distance an offset looks like a scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.diagnosis.pictures.spread import confirmed
from vispeg.diagnosis.selection.state import State
from vispeg.effects.common.camera import CameraEffect
from vispeg.identify.fit import Fit
from vispeg.identify.pictures.sensor import SensorEvidence
from vispeg.worlds.world import World

Parts = tuple[tuple[str, ...], ...]


def in_parts(search: PictureSearch, state: State) -> tuple[State, tuple[str, ...]]:
    """Return the state with every found effect reduced to the fewest parts that the pictures need.

    An effect that is a part of a wider one, as `depth_scale` is of `depth_bias`, is replaced by it if another part is
    present instead.

    Args:
        search: of a sensor's effects.
        state: final state of the search, with confirmed intervals.

    Returns:
        The state, and a message for every effect with competing sets of parts.
    """
    messages = []
    for here in range(state.n_fixed, len(state.world.effects)):
        placed = state.world.effects[here]
        kind = effect(placed.effect)
        assert isinstance(kind, CameraEffect)
        wide = effect(kind.part_of[0]) if kind.part_of else kind
        assert isinstance(wide, CameraEffect)
        if not wide.parts:
            continue
        full = state
        if wide is not kind:
            full = _fitted(search, state, _put(state.world, here, EffectInstance.of(wide.name, placed.where)))
        assert full.fit is not None
        chosen, *others = smallest(full.fit, here, wide.parts)
        if others:
            sets = ", ".join(" and ".join(names[0].split("_")[0] for names in kept) for kept in (chosen, *others))
            messages.append(f"{placed.label}: these distances cannot tell which it is of {sets}")
        if kind.part_of and any(kept == ((kind.part_of[1],),) for kept in (chosen, *others)):
            continue  # the part with a name of its own
        absent = [name for part in wide.parts if part not in chosen for name in part]
        if not absent:
            state = full
            continue
        reduced = full.world.effects[here].with_values(**{k: wide.params[k].null for k in absent})
        state = _fitted(search, state, _put(full.world, here, reduced), [(wide.name, k) for k in absent])
    return state, tuple(messages)


def _put(world: World, index: int, placed: EffectInstance) -> World:
    return replace(world, effects=(*world.effects[:index], placed, *world.effects[index + 1 :]))


def _fitted(search: PictureSearch, state: State, world: World, held: Sequence[tuple[str, str]] = ()) -> State:
    """Return the state of another world, fitted with some effect parameters held, and with confirmed intervals."""
    search = copy(search)
    assert isinstance(search.evidence, SensorEvidence) and isinstance(search.judged, SensorEvidence)
    search.evidence, search.judged = search.evidence.holding(held), search.judged.holding(held)
    (fit,) = search.fits([world], state.n_fixed)
    loss = search.judge.losses([fit.world])[0]
    fitted = replace(state, world=fit.world, fit=fit, loss=loss, residual=fit.residual, last=[])
    return confirmed(search, fitted)


def smallest(fit: Fit, index: int, parts: Parts) -> list[Parts]:
    """Return the smallest sets of parts such that a fit cannot distinguish the others from null, the likeliest first.

    Args:
        fit: with all parts free.
        index: of the effect in the fit's world.
        parts: the effect's parameters, part by part.
    """
    axes = fit.space.axes
    axis_of = {a.name: k for k, a in enumerate(axes) if a.index == index}
    covariance = fit.correlation * np.outer(fit.sigma, fit.sigma)
    off = fit.u - np.array([fit.space.forward(a.param.null, a) for a in axes])

    def absent(kept: Parts) -> float:
        """Return the confidence at which a fit rejects that the other parts are null."""
        rows = [axis_of[n] for part in parts if part not in kept for n in part if n in axis_of]
        if not rows:
            return 0.0
        block = covariance[np.ix_(rows, rows)]
        wald = float(off[rows] @ np.linalg.pinv(block, rcond=1e-9) @ off[rows])
        return float(stats.chi2.cdf(wald, len(rows)))

    for count in range(1, len(parts) + 1):
        passed = [(absent(kept), kept) for kept in combinations(parts, count)]
        if good := sorted((p, kept) for p, kept in passed if p < 1 - RULES.part_level):
            return [kept for _, kept in good]
    return [parts]
