"""Intervals of fitted values that count the error of the model's form beside the noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.core.effect import Value, effect
from vispeg.worlds.world import World


def widened(world: World, given: int, before: float, after: float) -> World:
    """Fitted intervals widened by what the model's form leaves: no fit is truer than the share of error it removes.

    The amplitude of the held-out excess that remains over the one there was is taken as a relative standard error.
    """
    left = float(np.sqrt(max(after - 1.0, 0.0) / max(before - 1.0, 1e-9)))
    effects = list(world.effects)
    for i, e in enumerate(effects[given:], given):
        params = {}
        for name, v in e.params.items():
            p = effect(e.effect).params[name]
            if v.low is None or v.high is None:
                params[name] = v
            elif p.scale == "log":
                half = np.hypot(np.log(v.high / v.low) / 2, 1.96 * left)
                bounds = np.clip(v.value * np.exp([-half, half]), p.low, p.high)
                params[name] = Value(v.value, float(bounds[0]), float(bounds[1]))
            else:
                more = 1.96 * left * abs(v.value - (0.0 if p.shape else p.null))
                low, high = v.value - np.hypot(v.value - v.low, more), v.value + np.hypot(v.high - v.value, more)
                params[name] = Value(v.value, float(max(low, p.low)), float(min(high, p.high)))
        effects[i] = replace(e, params=params)
    return replace(world, effects=tuple(effects))
