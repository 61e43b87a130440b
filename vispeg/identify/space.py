"""The free parameters of a world as a vector that an optimizer can move in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.params import Param
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Axis:
    """One free parameter: which effect of the world, which parameter, and its Param."""

    index: int
    name: str
    param: Param

    @property
    def unit(self) -> float:
        """Length of one optimizer unit: a typical size of the parameter (1 on a log scale)."""
        if self.param.scale == "log":
            return 1.0
        size = abs(self.param.start - self.param.null) if not self.param.shape else 0.0
        return size or (self.param.high - self.param.low) / 20.0


class Space:
    """All parameters of the effects at `free` (indices into `world.effects`), in optimizer units."""

    def __init__(self, world: World, free: Sequence[int]):
        self.world = world
        self.axes = [
            Axis(i, name, param) for i in free for name, param in effect(world.effects[i].effect).params.items()
        ]

    def forward(self, value: float, axis: Axis) -> float:
        """Optimizer coordinate of a parameter value."""
        return float(np.log(value)) if axis.param.scale == "log" else value / axis.unit

    def backward(self, u: float, axis: Axis) -> float:
        """Parameter value of an optimizer coordinate, inside its bounds."""
        value = float(np.exp(u)) if axis.param.scale == "log" else float(u) * axis.unit
        return float(np.clip(value, axis.param.low, axis.param.high))

    @property
    def start(self) -> np.ndarray:
        """Coordinates of the world's present values."""
        return np.array([self.forward(self.world.effects[a.index].params[a.name].value, a) for a in self.axes])

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds in optimizer coordinates."""
        low = np.array([self.forward(a.param.low, a) for a in self.axes])
        return low, np.array([self.forward(a.param.high, a) for a in self.axes])

    def at(self, u: np.ndarray) -> World:
        """The world at coordinates u."""
        effects: list[EffectInstance] = list(self.world.effects)
        for axis, value in zip(self.axes, u, strict=True):
            effects[axis.index] = effects[axis.index].with_values(**{axis.name: self.backward(value, axis)})
        return World(self.world.robot, self.world.tool, tuple(effects))

    def steps(self, u: np.ndarray) -> np.ndarray:
        """Finite-difference steps, pointing away from the nearer bound.

        A rough effect needs longer ones, but not on a log scale, where a unit is long already: 5 % of a ripple's poles
        is most of a radian of phase.
        """
        low, high = self.bounds
        long = [not effect(self.world.effects[a.index].effect).smooth and a.param.scale == "linear" for a in self.axes]
        size = np.where(long, 0.05, 0.02)
        return np.where(u + size <= high, size, -size)
