"""Randomized worlds: effects whose parameters are drawn for every episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from vispeg.core.counts import count
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.worlds.distribution import Distribution
from vispeg.worlds.places import instances
from vispeg.worlds.world import World

NORMAL = NormalDist()


@dataclass(frozen=True)
class RandomizedEffect:
    """An effect whose parameters are drawn anew for every episode.

    Attributes:
        effect, where: as in EffectInstance; `each` draws separately for every target.
        params: parameter -> number or distribution; others stay at null (shape parameters at `start`).
        source: where the range comes from, for readers.
        group: name of a group of effects whose parameters are drawn with a common Gaussian factor.
        rho: share of each parameter's variance that comes from that factor, -1 to 1; negative for the opposite
            direction. Two parameters of equal `rho` have the correlation |rho|.
        chance: probability that an episode has the effect.
    """

    effect: str
    where: str
    params: Mapping[str, float | Distribution]
    source: str = ""
    group: str = ""
    rho: float = 0.0
    chance: float = 1.0

    @property
    def label(self) -> str:
        """Effect and place as text: `contact_friction(gripper)`."""
        return f"{self.effect}({self.where})"

    def draw(self, seed: int, where: str, level: float = 1.0) -> EffectInstance | None:
        """Draw the effect for one episode; None if the episode does not have it.

        Args:
            seed: of the episode.
            where: the target.
            level: 0 to 1, scales the distance of drawn values from null, except those of shape parameters.
        """
        rng = stream(seed, "world", self.effect, where)
        without = rng.uniform() >= self.chance
        values = {}
        for name in sorted(self.params):
            # drawn for fixed numbers too, so that they do not change the draws of the parameters after them
            normal, stated = rng.standard_normal(), self.params[name]
            if isinstance(stated, (int, float)):
                values[name] = float(stated)
                continue
            if self.group:
                common = stream(seed, "world-group", self.group).standard_normal()
                normal = np.sqrt(abs(self.rho)) * common * np.sign(self.rho) + np.sqrt(1 - abs(self.rho)) * normal
            value, param = stated.at(NORMAL.cdf(normal)), effect(self.effect).params[name]
            values[name] = value if param.shape or level == 1.0 else param.null + level * (value - param.null)
        return None if without else EffectInstance.of(self.effect, where, **values)


@dataclass(frozen=True)
class RandomizedWorld:
    """A world with some effects that are drawn anew for every episode.

    Attributes:
        ranges: the drawn effects.
        base: robot, tool, and the effects that are the same in every episode.
    """

    ranges: tuple[RandomizedEffect, ...] = ()
    base: World = World()

    def __repr__(self) -> str:
        return f"<RandomizedWorld: {count(len(self.ranges), 'effect')} drawn in every episode, from {self.base!r}>"

    @classmethod
    def of(cls, world: World | RandomizedWorld) -> RandomizedWorld:
        """Return a world as a RandomizedWorld; a World has no ranges."""
        return cls(base=world) if isinstance(world, World) else world

    def sample(self, seed: int, model: Any, levels: Mapping[str, float] | float = 1.0) -> World:
        """Draw the world of one episode.

        Each range uses its own random stream, keyed by (seed, effect, where). So a seed gives the same values
        regardless of other ranges.

        Args:
            seed: of the episode.
            model: the RobotModel or Scene whose targets `each` stands for, see `places.instances`.
            levels: 0 to 1, for all ranges or by label, see `RandomizedEffect.draw`; ranges without one have 1.
        """
        drawn = []
        for r in self.ranges:
            level = levels if isinstance(levels, (int, float)) else levels.get(r.label, 1.0)
            places = instances(effect(r.effect), r.where, model)
            drawn += [d for where in places if (d := r.draw(seed, where, float(level))) is not None]
        return self.base.add(*drawn)

    def middle(self, model: Any) -> World:
        """Return the world with all parameters at their medians, without effects whose `chance` is below 0.5."""
        drawn = []
        for r in self.ranges:
            values = {k: v if isinstance(v, (int, float)) else v.at(0.5) for k, v in r.params.items()}
            if r.chance >= 0.5:
                drawn += [
                    EffectInstance.of(r.effect, at, **values) for at in instances(effect(r.effect), r.where, model)
                ]
        return self.base.add(*drawn)

    def only(self, wanted: Callable[[EffectInstance | RandomizedEffect], bool]) -> RandomizedWorld:
        """Return this world with only those effects and ranges for which `wanted` returns True."""
        return replace(self, ranges=tuple(filter(wanted, self.ranges)), base=self.base.only(wanted))

    @property
    def entries(self) -> tuple[EffectInstance | RandomizedEffect, ...]:
        """All effects of the world, fixed ones first, then ranges."""
        return (*self.base.effects, *self.ranges)

    @property
    def label(self) -> str:
        """The world as text, `nominal + contact_friction(gripper)`, with ranges by their labels."""
        return " + ".join(["nominal", *(e.label for e in self.entries)])
