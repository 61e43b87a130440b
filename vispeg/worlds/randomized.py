"""Randomized worlds: effects whose parameters are drawn for every episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

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
        params: a number or a distribution each; what is not named stays at null (or at its start, for a shape).
        source: where the range comes from.
        group: effects of one group share a Gaussian factor: their parameters move together with correlation `rho`.
        chance: how often an episode has the effect at all.
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
        """`contact_friction(gripper)`."""
        return f"{self.effect}({self.where})"

    def draw(self, seed: int, where: str, level: float = 1.0) -> EffectInstance | None:
        """Return the effect at `where` for one seed; None where this episode does without it.

        Args:
            seed: of the episode.
            where: the target.
            level: 0 to 1, how far a draw may leave the nominal value (a curriculum's knob).
        """
        rng = stream(seed, "world", self.effect, where)
        without = rng.uniform() >= self.chance
        values = {}
        for name in sorted(self.params):
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
    """A world of which a part is drawn anew for every episode.

    Attributes:
        ranges: what is drawn.
        base: robot, tool, and effects that are the same in every episode.
    """

    ranges: tuple[RandomizedEffect, ...] = ()
    base: World = World()

    def __repr__(self) -> str:
        return f"<RandomizedWorld: {len(self.ranges)} effects drawn in every episode, from {self.base!r}>"

    @classmethod
    def of(cls, world: World | RandomizedWorld) -> RandomizedWorld:
        """Return the world itself: a drawn world does not vary."""
        return cls(base=world) if isinstance(world, World) else world

    def sample(self, seed: int, model: Any, levels: Mapping[str, float] | float = 1.0) -> World:
        """Every range drawn, from nominal and from a stream of its own keyed by (seed, name, where).

        Args:
            seed: of the episode; the same seed gives the same values whatever other ranges there are.
            model: the RobotModel or Scene whose targets `where: each` walks.
            levels: 0 to 1, for all ranges or by label: how far draws may leave nominal.
        """
        drawn = []
        for r in self.ranges:
            level = levels if isinstance(levels, (int, float)) else levels.get(r.label, 1.0)
            places = instances(effect(r.effect), r.where, model)
            drawn += [d for where in places if (d := r.draw(seed, where, float(level))) is not None]
        return self.base.add(*drawn)

    def middle(self, model: Any) -> World:
        """Every range at its median; what fewer than half of the episodes have is left out."""
        drawn = []
        for r in self.ranges:
            values = {k: v if isinstance(v, (int, float)) else v.at(0.5) for k, v in r.params.items()}
            if r.chance >= 0.5:
                drawn += [
                    EffectInstance.of(r.effect, at, **values) for at in instances(effect(r.effect), r.where, model)
                ]
        return self.base.add(*drawn)

    def only(self, wanted: Callable[[EffectInstance | RandomizedEffect], bool]) -> RandomizedWorld:
        """Return this world with the wanted effects and ranges alone."""
        return replace(self, ranges=tuple(filter(wanted, self.ranges)), base=self.base.only(wanted))

    @property
    def entries(self) -> tuple[EffectInstance | RandomizedEffect, ...]:
        """All that makes the world differ from nominal, drawn or not."""
        return (*self.base.effects, *self.ranges)

    @property
    def label(self) -> str:
        """`nominal + contact_friction(gripper)`; what is drawn stands by its name."""
        return " + ".join(["nominal", *(e.label for e in self.entries)])
