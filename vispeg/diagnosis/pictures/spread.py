"""Uncertainty of a fitted value: difference between recordings and appearances, error of form, refused effects.

A change of appearance shifts all edges of one recording alike, so the spread between its views does not contain it.
Two recordings fitted separately differ by it: with a variance (f - 1) s^2 in addition to each fit's s^2, a difference
d has a mean square of 2 f s^2. One parameter says little about f, so it is estimated from all fitted ones together:
the mean of d^2 / (2 s^2), at least 1 (the random effects of DerSimonian and Laird, Controlled Clinical Trials 7(3),
1986, for two studies). It has as many degrees of freedom as there are parameters, the fit as many as it has views;
Student's t is that of their sum (Satterthwaite, Biometrics Bulletin 2(6), 1946). Two errors are in neither. One is a
camera error common to all frames that no effect describes: it shifts each figure as a whole. The other is what a
refused effect would take over: the truth lies anywhere between the values with it and without it (a lean model
understates its uncertainty; Kogan, mrcal documentation, "projection uncertainty").
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance
from vispeg.core.params import Value
from vispeg.core.rules import RULES
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.diagnosis.selection.state import State
from vispeg.identify.fit import Fit


def confirmed(search: PictureSearch, state: State) -> State:
    """Return the state with intervals that include the values at which the held-out recordings put its effects."""
    if state.fit is None or len(state.world.effects) <= state.n_fixed:
        return state
    (other,) = search.fits([state.world], state.n_fixed, search.judged)
    form = np.hypot(of_form(state.fit, search.evidence.common_errors()), taken_over(search, state))
    fit = widened(state.fit, other, len(np.unique(search.evidence.blocks())), form)
    return replace(state, fit=fit, world=fit.world)


def of_form(fit: Fit, alike: np.ndarray) -> np.ndarray:
    """Return the standard errors (k,) of a fit's coordinates due to errors common to all frames.

    Args:
        fit: of k coordinates to n residuals.
        alike: (n, c) residuals that one standard deviation of each of c such unknowns makes.
    """
    moved, *_ = np.linalg.lstsq(fit.jacobian, alike, rcond=1e-6)
    return np.sqrt(np.sum(moved**2, axis=1))


def taken_over(search: PictureSearch, state: State) -> np.ndarray:
    """Return (k,) standard errors of the coordinates: their shift if the best refused effect were added."""
    fit = state.fit
    assert fit is not None
    accepted = [(e.effect, e.where) for e in state.world.effects]  # the last refusals may be relative to another world
    beside = [t for t in state.last if [(e.effect, e.where) for e in t.fit.world.effects[: len(accepted)]] == accepted]
    richer = [
        t for t in beside if t.gain.z > stats.norm.isf(RULES.level) and t.gain.relative > search.evidence.least_gain
    ]
    if not richer or len(richer[0].fit.u) <= len(fit.u):
        return np.zeros(len(fit.u))
    return np.abs(richer[0].fit.u[: len(fit.u)] - fit.u) / np.sqrt(3)  # RMS of a value anywhere between


def widened(fit: Fit, other: Fit, blocks: int, of_form: np.ndarray | float = 0.0) -> Fit:
    """Return a fit whose standard errors and 95 % intervals include the result on another recording.

    Args:
        fit, other: of the same effects.
        blocks: independent blocks of data behind the first.
        of_form: (k,) standard errors due to errors common to all recordings.
    """
    count, away = len(fit.u), np.abs(fit.u - other.u) / np.sqrt(2)
    own_freedom = max(2, blocks - count)
    excess = max(0.0, float(np.mean((away / np.maximum(fit.sigma, 1e-12)) ** 2)) - 1.0)  # f - 1
    freedom = (1 + excess) ** 2 / (1 / own_freedom + excess**2 / count)
    t = float(stats.t.ppf(0.975, freedom))
    sigma = np.hypot(np.maximum(np.sqrt(1 + excess) * fit.sigma, away), of_form)
    (low, high), placed = fit.space.bounds, list(fit.world.effects)
    for k, axis in enumerate(fit.space.axes):
        ends = np.clip([fit.u[k] - t * sigma[k], fit.u[k] + t * sigma[k]], low[k], high[k])
        bounds = sorted(fit.space.backward(float(v), axis) for v in ends)
        e = placed[axis.index]
        params = {**e.params, axis.name: Value(e.params[axis.name].value, *bounds)}
        placed[axis.index] = EffectInstance(e.effect, e.where, params, e.origin)
    return replace(fit, world=replace(fit.world, effects=tuple(placed)), sigma=sigma)
