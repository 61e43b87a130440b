"""The free parameters of a world as a vector of coordinates, in units that suit an optimizer.

A unit is a typical size of the parameter, or 1 in the logarithm of a parameter on a log scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.core.effect import Effect, EffectInstance, effect
from vispeg.core.params import Param
from vispeg.worlds.world import World

SHORTEST = 1e-3  # shortest finite-difference step, in units


@dataclass(frozen=True)
class Axis:
    """One free parameter: index of its effect in the world, its name, and its Param."""

    index: int
    name: str
    param: Param

    @property
    def unit(self) -> float:
        """Length of one optimizer unit: 1 on a log scale, else a typical size, or a twentieth of a shape's range."""
        if self.param.scale == "log":
            return 1.0
        size = abs(self.param.start - self.param.null) if not self.param.shape else 0.0
        return size or (self.param.high - self.param.low) / 20.0


class Freedom:
    """The parameters that a fit may change, and their finite-difference steps; subclasses override either.

    Attributes:
        held: parameters (effect, name) that stay fixed; for use by subclasses.
    """

    held: frozenset[tuple[str, str]] = frozenset()

    def frees(self, kind: Effect, name: str) -> bool:
        """Return whether a fit may change this parameter of an effect."""
        return True

    def nudge(self, kind: Effect, name: str) -> float | None:
        """Return the finite-difference step of a parameter, in its physical unit or in its logarithm; None: default."""
        return None


class Space:
    """The parameters that `freedom` allows (by default all) of the effects at `free`, indices into `world.effects`."""

    def __init__(self, world: World, free: Sequence[int], freedom: Freedom | None = None):
        self.freedom = freedom or Freedom()
        self.world = world
        kinds = {i: effect(world.effects[i].effect) for i in free}
        self.axes = [
            Axis(i, name, param)
            for i, k in kinds.items()
            for name, param in k.params.items()
            if self.freedom.frees(k, name)
        ]

    def forward(self, value: float, axis: Axis) -> float:
        """Return the optimizer coordinate of a parameter value."""
        return float(np.log(value)) if axis.param.scale == "log" else value / axis.unit

    def backward(self, u: float, axis: Axis) -> float:
        """Return the parameter value of an optimizer coordinate, clipped to its bounds."""
        value = float(np.exp(u)) if axis.param.scale == "log" else float(u) * axis.unit
        return float(np.clip(value, axis.param.low, axis.param.high))

    @property
    def start(self) -> np.ndarray:
        """Return the coordinates of the world's present values."""
        return np.array([self.forward(self.world.effects[a.index].params[a.name].value, a) for a in self.axes])

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds in optimizer coordinates."""
        low = np.array([self.forward(a.param.low, a) for a in self.axes])
        return low, np.array([self.forward(a.param.high, a) for a in self.axes])

    def at(self, u: np.ndarray) -> World:
        """Return the world at coordinates u."""
        effects: list[EffectInstance] = list(self.world.effects)
        for axis, value in zip(self.axes, u, strict=True):
            effects[axis.index] = effects[axis.index].with_values(**{axis.name: self.backward(value, axis)})
        return replace(self.world, effects=tuple(effects))

    def steps(self, u: np.ndarray) -> np.ndarray:
        """Return finite-difference steps (naxis,) at `u`, negative if a positive one would pass the upper bound.

        A step is 0.02 of a unit; on a linear scale, at most a tenth of the value's distance from null, as some values
        are much smaller than their unit (the rotor inertia of a wrist), but at least `SHORTEST`. If the residual is not
        smooth in the effect, a step is 0.05 of a unit. This does not apply to a log scale: a ripple with 5 % more poles
        would be out of phase by most of a radian. Steps that `freedom` states replace these.
        """
        low, high = self.bounds
        rough = [not effect(self.world.effects[a.index].effect).smooth and a.param.scale == "linear" for a in self.axes]
        size = np.where(rough, 0.05, 0.02)
        for i, a in enumerate(self.axes):
            if not rough[i] and a.param.scale == "linear" and not a.param.shape:
                size[i] = np.clip(0.1 * abs(u[i] - self.forward(a.param.null, a)), SHORTEST, size[i])
        for i, a in enumerate(self.axes):
            step = self.freedom.nudge(effect(self.world.effects[a.index].effect), a.name)
            size[i] = size[i] if step is None else step / a.unit
        return np.where(u + size <= high, size, -size)
