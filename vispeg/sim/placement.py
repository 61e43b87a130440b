"""From worlds to arrays: which effects are at work in a batch, and their parameters row by row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import Effect, effect
from vispeg.core.errors import UserError
from vispeg.robots.model import RobotModel
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Active:
    """An effect present in some row, with its parameters (nsim, ntarget), null where it is absent."""

    effect: Effect
    p: dict[str, np.ndarray]


def activate(robot: RobotModel, worlds: Sequence[World]) -> list[Active]:
    """Effects at work in any of the worlds, in the order of their drive stage."""
    names = sorted({e.effect for w in worlds for e in w.effects}, key=lambda n: (effect(n).order, n))
    return [Active(effect(n), _values(effect(n), robot, worlds)) for n in names]


def _values(kind: Effect, robot: RobotModel, worlds: Sequence[World]) -> dict[str, np.ndarray]:
    targets = kind.targets(robot)
    p = kind.absent((len(worlds), len(targets)))
    for row, world in enumerate(worlds):
        for placed in world.effects:
            if placed.effect != kind.name:
                continue
            if placed.where != "all" and placed.where not in targets:
                raise UserError(f"{kind.name} has no such place", got=placed.where, choices=[*targets, "all"])
            column = slice(None) if placed.where == "all" else targets.index(placed.where)
            for k, value in placed.params.items():
                p[k][row, column] = value.value
    return p
