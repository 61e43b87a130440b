"""How far a fitted value may be off: as far as another recording, in another light, puts it.

What a look does to all edges of one recording is in no spread between its views. Two recordings that were fitted apart
differ by it: with an unknown variance t^2 beside each fit's s^2, the difference d has a mean square of 2 (s^2 + t^2),
and max(s^2, d^2 / 2) estimates s^2 + t^2 (the random effects of DerSimonian and Laird, Controlled Clinical Trials 7(3),
1986, for two studies).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance, Value
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.diagnosis.selection.state import State
from vispeg.identify.fit import Fit


def confirmed(search: PictureSearch, state: State, given: int) -> State:
    """The state with intervals that allow for where the recordings to judge on would put its effects."""
    if state.fit is None or len(state.world.effects) <= given:
        return state
    (other,) = search.fits([state.world], given, search.judged)
    fit = widened(state.fit, other, len(np.unique(search.evidence.blocks())))
    return replace(state, fit=fit, world=fit.world)


def widened(fit: Fit, other: Fit, blocks: int) -> Fit:
    """A fit whose standard errors and 95 % intervals allow for where another recording's fit ended.

    Args:
        fit, other: of the same effects.
        blocks: independent blocks of data behind the first, for Student's t.
    """
    sigma = np.maximum(fit.sigma, np.abs(fit.u - other.u) / np.sqrt(2))
    t = float(stats.t.ppf(0.975, max(2, blocks - len(fit.u))))
    (low, high), placed = fit.space.bounds, list(fit.world.effects)
    for k, axis in enumerate(fit.space.axes):
        ends = np.clip([fit.u[k] - t * sigma[k], fit.u[k] + t * sigma[k]], low[k], high[k])
        bounds = sorted(fit.space.backward(float(v), axis) for v in ends)
        e = placed[axis.index]
        params = {**e.params, axis.name: Value(e.params[axis.name].value, *bounds)}
        placed[axis.index] = EffectInstance(e.effect, e.where, params, e.origin)
    return replace(fit, world=replace(fit.world, effects=tuple(placed)), sigma=sigma)
