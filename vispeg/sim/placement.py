"""Convert worlds to arrays: the effects that are active in a batch, and their parameters row by row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from vispeg.core.effect import Effect, effect
from vispeg.worlds.places import values
from vispeg.worlds.world import World


class Model(Protocol):
    """What effects have places on: a RobotModel, a Scene, an ObjectModel."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of its joints; none of a free object."""
        ...

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the bodies that the joints move."""
        ...

    @property
    def flange(self) -> str:
        """Name of the site that carries a tool; "" where there is none."""
        ...


@dataclass(frozen=True)
class Active:
    """An effect present in some row, with its parameters (nsim, ntarget), null where it is absent."""

    effect: Effect
    p: dict[str, np.ndarray]


def activate(model: Model, worlds: Sequence[World]) -> list[Active]:
    """Return the effects that are active in any of the worlds, in the order of their drive stage."""
    names = sorted({e.effect for w in worlds for e in w.effects}, key=lambda n: (effect(n).order, n))
    return [Active(effect(n), values(effect(n), [w.effects for w in worlds], model)) for n in names]
