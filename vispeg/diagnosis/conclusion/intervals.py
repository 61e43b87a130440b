"""Intervals of fitted values that include the error of the model's form in addition to noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.params import Param, Value
from vispeg.worlds.world import World


def widened(world: World, n_fixed: int, before: float, after: float) -> World:
    """Return the world with intervals widened by the error of the model's form.

    The relative standard error of each value's distance from null is the ratio of the held-out excess amplitudes over
    noise, after to before. It acts on a log scale, so that an interval that excludes null still does so after widening.
    """
    relative_error = 1.96 * float(np.sqrt(max(after - 1.0, 0.0) / max(before - 1.0, 1e-9)))
    effects = list(world.effects)
    for i, e in enumerate(effects[n_fixed:], n_fixed):
        parameters = effect(e.effect).params
        effects[i] = replace(
            e, params={name: _wider(v, parameters[name], relative_error) for name, v in e.params.items()}
        )
    return replace(world, effects=tuple(effects))


def _wider(v: Value, p: Param, relative_error: float) -> Value:
    if v.low is None or v.high is None:
        return v
    null = p.origin
    if p.scale == "log":
        half = np.hypot(np.log(v.high / v.low) / 2, relative_error)
        ends = v.value * np.exp([-half, half])
    elif v.low <= null <= v.high:
        more = relative_error * abs(v.value - null)
        ends = np.array([v.value - np.hypot(v.value - v.low, more), v.value + np.hypot(v.high - v.value, more)])
    else:
        ratio = np.log((np.array([v.low, v.high]) - null) / (v.value - null))
        ends = null + (v.value - null) * np.exp(np.sign(ratio) * np.hypot(ratio, relative_error))
    low, high = np.clip(np.sort(ends), p.low, p.high)
    return Value(v.value, float(min(low, v.value)), float(max(high, v.value)))
