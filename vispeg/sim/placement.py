"""Convert worlds to arrays: the effects that are active in a batch, and their parameters row by row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import Effect, effect
from vispeg.robots.model import RobotModel
from vispeg.worlds.places import values
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Active:
    """An effect present in some row, with its parameters (nsim, ntarget), null where it is absent."""

    effect: Effect
    p: dict[str, np.ndarray]


def activate(robot: RobotModel, worlds: Sequence[World]) -> list[Active]:
    """Return the effects that are active in any of the worlds, in the order of their drive stage."""
    names = sorted({e.effect for w in worlds for e in w.effects}, key=lambda n: (effect(n).order, n))
    return [Active(effect(n), values(effect(n), [w.effects for w in worlds], robot)) for n in names]
