"""Profile of a contact parameter: the error of toss windows of one length over its values.

An interval by bootstrap over tosses says whether windows of that length determine the parameter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.params import Param
from vispeg.identify.restarts import Restarts
from vispeg.identify.surface import DRAWS, cost, lowest
from vispeg.worlds.world import World

SPAN, POINTS = 6.0, 13  # factor from the value to either end of a scale's profile; most points of a profile


@dataclass(frozen=True)
class Profile:
    """The error of windows over one parameter, all others held fixed.

    Attributes:
        label: such as `contact_friction(cube).scale`.
        values: (n,) of the parameter, increasing; at most POINTS.
        error: (n,) mean squared whitened residual at each.
        best, low, high: value of least error, and the ends of its 95 % interval.
        determined: whether these windows determine the parameter.
    """

    label: str
    values: np.ndarray
    error: np.ndarray
    best: float
    low: float
    high: float
    determined: bool


def sizes(param: Param) -> list[float]:
    """Return values of a parameter to try, on both sides of null and without it.

    Null is the value at which the effect does nothing; a parameter with a positive null is a scale. On each side a
    value is about half as far from null as the next. To first order a tried size lowers the error if the true one is
    more than half as large, so one of them detects any visible effect.
    """
    if param.null > 0:
        away = np.log(12) / 2.0 ** np.arange(6)  # from a factor of 12 down
        values = param.null * np.exp(np.concatenate([-away, away[::-1]]))
    else:
        values = param.null + (param.start - param.null) * np.array([-2.0, -1.0, -0.5, 0.25, 0.5, 1.0, 1.5])
    inside = (values >= max(param.low, 1e-9 if param.null > 0 else -np.inf)) & (values <= param.high)
    return [float(v) for v in values[inside] if abs(v - param.null) > 1e-9]


def profile(evidence: Restarts, world: World, placed: EffectInstance, name: str, rng: np.random.Generator) -> Profile:
    """Return the profile of the parameter `name` of an effect in `world`.

    Of a scale it extends by the factor `SPAN` around the effect's value, else over the parameter's whole range.
    """
    param = effect(placed.effect).params[name]
    centre = placed.params[name].value
    if param.null > 0:
        values = np.clip(centre * np.geomspace(1 / SPAN, SPAN, POINTS), max(param.low, 1e-6), param.high)
    else:
        values = np.linspace(param.low, param.high, POINTS)
    values = np.unique(values)
    total = cost(evidence, [world.add(placed.with_values(**{name: float(v)})) for v in values])  # (values, tosses)
    size = np.bincount(evidence.blocks())
    axis = np.log(values) if param.null > 0 else values
    error = total.sum(axis=1) / size.sum()
    drawn = rng.multinomial(total.shape[1], np.full(total.shape[1], 1 / total.shape[1]), size=DRAWS)  # (draws, tosses)
    bests = np.array([lowest(axis, total @ d / (size @ d)) for d in drawn])
    back = np.exp if param.null > 0 else (lambda x: x)
    ends = np.quantile(bests, [0.025, 0.975])
    low, best, high = (float(back(v)) for v in (ends[0], lowest(axis, error), ends[1]))
    inside = low > values[0] * (1 + 1e-9) and high < values[-1] * (1 - 1e-9)
    return Profile(f"{placed.label}.{name}", values, error, best, low, high, bool(inside))
