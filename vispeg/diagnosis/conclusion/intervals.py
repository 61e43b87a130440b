"""Intervals of fitted values that include the error of the model's form in addition to noise."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.params import Param, Value
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit
from vispeg.worlds.world import World

Z = 1.96  # 95 % of a normal distribution
Error = Callable[[int, str], float]  # (index of an effect in the world, parameter) -> half-width


def share_left(before: float, after: float) -> float:
    """Return the 95 % relative error of a value whose trace is proportional to it: Z times the ratio of the excess
    amplitudes over noise, after to before; 0 if there was nothing to explain.
    """
    if before <= max(1.0, after):
        return 0.0
    return Z * float(np.sqrt(max(after - 1.0, 0.0) / (before - 1.0)))


def absorbed(fit: Fit, count: int, after: float) -> Error:
    """Return the 95 % errors of fitted values in a model whose form is wrong, in the optimizer's units.

    What remains over noise has the norm E = sqrt(count (after - 1)). What of the wrong form lies in the span of the
    columns J has been absorbed by the values and cannot be seen any more. If it is as large as what remains, in any
    direction of that span alike, the covariance of the k values is E^2 / k (J'J)^-1.

    Args:
        fit: with derivatives J to optimizer coordinates.
        count: readings.
        after: mean squared whitened residual; 1 is noise.
    """
    inverse = np.diag(np.linalg.pinv(fit.jacobian.T @ fit.jacobian))
    half = Z * np.sqrt(count * max(after - 1.0, 0.0) / max(len(inverse), 1) * np.maximum(inverse, 0.0))
    found = {(a.index, a.name): h * (1.0 if a.param.scale == "log" else a.unit)
             for a, h in zip(fit.space.axes, half, strict=True)}  # fmt: skip
    return lambda index, name: float(found.get((index, name), 0.0))


def proportional(world: World, share: float) -> Error:
    """Return such errors where derivatives say little: a share of each value's distance from null."""

    def error(index: int, name: str) -> float:
        placed = world.effects[index]
        p = effect(placed.effect).params[name]
        return share * (1.0 if p.scale == "log" else abs(placed.params[name].value - p.origin))

    return error


def of_form(evidence: Evidence, fit: Fit | None, before: float, after: float) -> Error:
    """Return the errors of fitted values in a model whose form is wrong.

    Args:
        evidence: of the fit; where its solver's chatter (`rough`) makes derivatives noise, errors are proportional.
        fit: the values; None if nothing was fitted.
        before, after: mean squared whitened residual of the held-out recordings, without the fitted effects and with
            them; 1 is noise.
    """
    if fit is None:
        return lambda index, name: 0.0
    if evidence.rough:
        return proportional(fit.world, share_left(before, after))
    return absorbed(fit, evidence.count, after)


def widened(world: World, free: Iterable[int], error: Error) -> World:
    """Return the world with the intervals of the effects at `free` widened by an error of the form.

    The error acts on a log scale of the distance from null, so that an interval that excludes null still does so after
    widening.
    """
    effects = list(world.effects)
    for i in free:
        e, known = effects[i], effect(effects[i].effect).params
        effects[i] = replace(e, params={k: _wider(v, known[k], error(i, k)) for k, v in e.params.items()})
    return replace(world, effects=tuple(effects))


def _wider(v: Value, p: Param, error: float) -> Value:
    """Return a value with a wider interval; `error` is of the parameter, or of its logarithm on a log scale."""
    if v.low is None or v.high is None:
        return v
    null = p.origin
    if p.scale == "log":
        half = np.hypot(np.log(v.high / v.low) / 2, error)
        ends = v.value * np.exp([-half, half])
    elif v.low <= null <= v.high:
        ends = np.array([v.value - np.hypot(v.value - v.low, error), v.value + np.hypot(v.high - v.value, error)])
    else:
        ratio = np.log((np.array([v.low, v.high]) - null) / (v.value - null))
        ends = null + (v.value - null) * np.exp(np.sign(ratio) * np.hypot(ratio, error / abs(v.value - null)))
    low, high = np.clip(np.sort(ends), p.low, p.high)
    return Value(v.value, float(min(low, v.value)), float(max(high, v.value)))
