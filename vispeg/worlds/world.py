"""A world: a nominal robot plus effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.worlds.distribution import Distribution

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
        """`contact_friction(peg)`."""
        return f"{self.effect}({self.where})"

    def draw(self, seed: int, where: str, level: float = 1.0) -> EffectInstance | None:
        """The effect at `where` for one seed; None where this episode does without it.

        Args:
            seed: of the episode.
            where: the target.
            level: 0 to 1, how far a draw may leave the nominal value (a curriculum's knob).
        """
        rng = stream(seed, "world", self.effect, where)
        absent = rng.uniform() >= self.chance
        values = {}
        for name in sorted(self.params):
            own, given = rng.standard_normal(), self.params[name]
            if isinstance(given, (int, float)):
                values[name] = float(given)
                continue
            if self.group:
                common = stream(seed, "world-group", self.group).standard_normal()
                own = np.sqrt(abs(self.rho)) * common * np.sign(self.rho) + np.sqrt(1 - abs(self.rho)) * own
            value, param = given.at(NORMAL.cdf(own)), effect(self.effect).params[name]
            values[name] = value if param.shape or level == 1.0 else param.null + level * (value - param.null)
        return None if absent else EffectInstance.of(self.effect, where, **values)


@dataclass(frozen=True)
class World:
    """A robot, its declared tool, and the effects that make it differ from nominal.

    Attributes:
        robot: a robot's name (`iiwa14`) or a path to an MJCF or URDF.
        tool: None, a tool's name, or a mapping with `mass_kg`, `com_m`, `inertia_kgm2` at the flange.
        effects: what is added to nominal, in any order.
        ranges: what is drawn anew by `sample`.
    """

    robot: str = "iiwa14"
    tool: Mapping[str, Any] | str | None = None
    effects: tuple[EffectInstance, ...] = ()
    ranges: tuple[RandomizedEffect, ...] = ()

    def sample(self, seed: int, model: Any, levels: Mapping[str, float] | float = 1.0) -> World:
        """This world with every range drawn, from nominal and from a stream of its own keyed by (seed, name, where).

        Args:
            seed: of the episode; the same seed gives the same world whatever other ranges there are.
            model: the RobotModel or Scene whose targets `where: each` walks.
            levels: 0 to 1, for all ranges or by label: how far draws may leave nominal.
        """
        drawn = []
        for r in self.ranges:
            level = levels if isinstance(levels, (int, float)) else levels.get(r.label, 1.0)
            places = effect(r.effect).targets(model) if r.where == "each" else [r.where]
            drawn += [d for where in places if (d := r.draw(seed, where, float(level))) is not None]
        return replace(self, ranges=()).add(*drawn)

    def add(self, *effects: EffectInstance) -> World:
        """This world with effects added; one at the same place replaces its predecessor."""
        new = {(e.effect, e.where): e for e in (*self.effects, *effects)}
        return replace(self, effects=tuple(new.values()))

    def without(self, effect: str, where: str) -> World:
        """This world without one effect."""
        return replace(self, effects=tuple(e for e in self.effects if (e.effect, e.where) != (effect, where)))

    @property
    def label(self) -> str:
        """`nominal + coulomb_friction(joint4)`."""
        return " + ".join(["nominal", *(e.label for e in self.effects)])
