"""A world: a nominal robot plus effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from vispeg.core.effect import Placed


@dataclass(frozen=True)
class World:
    """A robot, its declared tool, and the effects that make it differ from nominal.

    Attributes:
        robot: a robot's name (`iiwa14`) or a path to an MJCF or URDF.
        tool: None, a tool's name, or a mapping with `mass_kg`, `com_m`, `inertia_kgm2` at the flange.
        effects: what is added to nominal, in any order.
    """

    robot: str = "iiwa14"
    tool: Mapping[str, Any] | str | None = None
    effects: tuple[Placed, ...] = ()

    def add(self, *effects: Placed) -> World:
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
