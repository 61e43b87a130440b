"""Intervals of fitted values that include the error of the model's form in addition to noise."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.params import Param, Value
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit, inverted
from vispeg.worlds.world import World

Z = 1.96  # 95 % of a normal distribution
Error = Callable[[int, str], float]  # (index of an effect in the world, parameter) -> half-width


def share_left(before: float, after: float, floor: float = 1.0) -> float:
    """Return the ratio of the excess amplitudes over `floor`, after to before.

    0 if there was nothing to explain, or nothing was explained.
    """
    if before <= max(floor, after):
        return 0.0
    return float(np.sqrt(max(after - floor, 0.0) / (before - floor)))


def absorbed(fit: Fit, share: float) -> Error:
    """Return the 95 % errors of fitted values in a model whose form is wrong.

    Let t be the trace of an effect, its change of the residual in these recordings, and J the derivatives to all values
    of the model, k of them the effect's own. If the effect's law is wrong, the error of its trace has a part within the
    span of J. The fit has absorbed this part in the values, so the residual does not show it. It is taken to be equally
    likely in all directions, and in k of them together as large as the part that the residual shows, `share` times |t|.
    Then the covariance of the k values is (share |t|)^2 / k (J'J)^-1. A single value to which the trace is proportional
    gets the relative error `share`; one that other effects can make up for, or a shape, which changes the trace less,
    gets a larger one.

    Args:
        fit: with derivatives to optimizer coordinates.
        share: of the error that the model leaves (`share_left`).
    """
    jacobian, axes = fit.jacobian, fit.space.axes
    variance = np.diag(inverted(jacobian.T @ jacobian)[0])
    found: dict[tuple[int, str], float] = {}
    for index in {a.index for a in axes}:
        own = [i for i, a in enumerate(axes) if a.index == index]
        kind = effect(fit.world.effects[index].effect)
        sizes = [i for i in own if axes[i].name in kind.magnitudes]
        trace = jacobian[:, sizes] @ np.array([_away(fit.world, index, axes[i].name) / axes[i].unit for i in sizes])
        half = Z * share * np.linalg.norm(trace) * np.sqrt(variance[own] / len(own))
        for i, h in zip(own, half, strict=True):
            found[index, axes[i].name] = float(h * axes[i].unit)
    return lambda index, name: found.get((index, name), 0.0)


def proportional(world: World, share: float) -> Error:
    """Return 95 % errors that are a share of each value's distance from null, for fits with unreliable derivatives."""
    return lambda index, name: Z * share * abs(_away(world, index, name))


def _away(world: World, index: int, name: str) -> float:
    """Return the signed distance of a value from null; on a log scale 1, as null may be out of reach."""
    placed = world.effects[index]
    p = effect(placed.effect).params[name]
    return 1.0 if p.scale == "log" else placed.params[name].value - p.origin


def of_form(evidence: Evidence, fit: Fit | None, before: float, after: float, floor: float = 1.0) -> Error:
    """Return the errors of fitted values in a model whose form is wrong.

    Args:
        evidence: of the fit; if its simulation is not smooth (`rough`), derivatives are noise, and errors are
            proportional to the values.
        fit: the values; None if nothing was fitted.
        before, after: mean squared whitened residual of the held-out recordings, without the fitted effects and with
            them; 1 is noise.
        floor: mean squared whitened residual that even the right model would have; above 1 if encoders are coarse or
            the loop feeds noise back.
    """
    if fit is None:
        return lambda index, name: 0.0
    share = share_left(before, after, floor)
    return proportional(fit.world, share) if evidence.rough else absorbed(fit, share)


def widened(world: World, free: Iterable[int], error: Error) -> World:
    """Return the world with the intervals of the effects at `free` widened by an error of the form.

    The end nearer to null moves on a log scale of its distance from null. So an interval that excludes null still does.
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
        below, above = np.log([v.value / v.low, v.high / v.value])
        ends = np.log(v.value) + np.array([-np.hypot(below, error), np.hypot(above, error)])
        ends = np.exp(np.clip(ends, np.log(p.low), np.log(p.high)))
    elif v.low <= null <= v.high:
        ends = np.array([v.value - np.hypot(v.value - v.low, error), v.value + np.hypot(v.high - v.value, error)])
    else:
        near, far = sorted((v.low, v.high), key=lambda end: abs(end - null))
        away = v.value - null
        near = null + away * np.exp(-np.hypot(np.log((near - null) / away), error / abs(away)))
        ends = np.array([near, v.value + np.sign(away) * np.hypot(far - v.value, error)])
    low, high = np.clip(np.sort(ends), p.low, p.high)
    return Value(v.value, float(min(low, v.value)), float(max(high, v.value)))
