"""Repeatability of the arm, which widens the interval of a part's pose beyond the noise of the recordings.

Errors of the kinematics are already part of the noise covariance (`vispeg.contact.errors.nuisance`), but linearised at
given contacts, so they do not shift the point where a contact begins. A pose is identified by that very point, so its
interval has to include the repeatability separately.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.worlds.world import World


def repeats() -> dict[str, float]:
    """Return the standard deviation with which an arm repeats a pose, by unit (m, rad)."""
    return {"m": RULES.repeats * RULES.kinematics_place, "rad": RULES.repeats * RULES.kinematics_turn}


def repeated(world: World, n_fixed: int) -> World:
    """Return the world with the pose intervals of effects after the first `n_fixed` widened by the arm's repeatability.

    A recording locates a part relative to the arm's own estimate of its pose, and so no more precisely than that.
    """
    return replace(world, effects=(*world.effects[:n_fixed], *map(allowing, world.effects[n_fixed:])))


def allowing(placed: EffectInstance) -> EffectInstance:
    """Return the effect with widened intervals; intervals of parameters that are not poses stay."""
    params = dict(placed.params)
    for k, v in params.items():
        if v.low is not None and v.high is not None and (margin := 1.96 * uncertainty(placed.effect, k)) > 0:
            param = effect(placed.effect).params[k]
            low, high = v.value - np.hypot(v.value - v.low, margin), v.value + np.hypot(v.high - v.value, margin)
            params[k] = replace(v, low=float(max(low, param.low)), high=float(min(high, param.high)))
    return replace(placed, params=params)


def uncertainty(name: str, parameter: str) -> float:
    """Return the standard uncertainty of a parameter due to the arm's repeatability; 0 if the effect is not a pose."""
    kind = effect(name)
    return repeats().get(kind.params[parameter].unit, 0.0) if kind.posed else 0.0
