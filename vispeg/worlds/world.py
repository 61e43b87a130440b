"""A world: a nominal robot plus effects with fixed values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.recordings.cell import CellBelief
from vispeg.robots.model import check_name
from vispeg.worlds.places import ALL


@dataclass(frozen=True)
class World:
    """A robot, its declared tool, and the effects that make it differ from nominal.

    Attributes:
        robot: a robot's name (`iiwa14`) or a path to an MJCF or URDF.
        tool: None, a tool's name, or a mapping with `mass_kg`, `com_m`, `inertia_kgm2` at the flange.
        effects: deviations from nominal, in any order.
        cell: settings of the cell around the robot; None for an arm alone.

    Raises:
        UserError: no robot of that name.
    """

    robot: str = "iiwa14"
    tool: Mapping[str, Any] | str | None = None
    effects: tuple[EffectInstance, ...] = ()
    cell: CellBelief | None = None

    def __post_init__(self) -> None:
        check_name(self.robot)

    def add(self, *effects: EffectInstance | str, **values: float) -> World:
        """Return this world with effects added; each replaces one of the same name at the same place.

        An added effect counts at its place even if the world also has that effect at `all` (see `places.values`).

        Args:
            effects: instances; or the name of one effect and its place, as in `add("payload", "flange", mass=1.2)`.
            values: parameters of that one effect; the others are null (shape parameters `start`).

        Raises:
            UserError: no such effect or parameter, or a name without a place.
        """
        placed = [e for e in effects if isinstance(e, EffectInstance)]
        names = [e for e in effects if isinstance(e, str)]
        if (names and (placed or len(names) != 2)) or (values and not names):
            expected = 'add("coulomb_friction", "joint4", torque=1.3), or instances of EffectInstance'
            raise UserError("one effect by its name and its place", expected=expected, got=effects)
        if names:
            placed = [EffectInstance.of(*names, **values)]
        by_place = {(e.effect, e.where): e for e in self.effects}
        for e in placed:
            at, order = (e.effect, e.where), [*by_place]
            if at in by_place and (e.effect, ALL) in order[order.index(at) + 1 :]:
                del by_place[at]  # it moves to the end: where it was, the later effect at `all` would override it
            by_place[at] = e
        return replace(self, effects=tuple(by_place.values()))

    def over(self, stated: Sequence[EffectInstance]) -> World:
        """Return this world with its cell's effects, `stated`, before its own; its own replace them as in `add`."""
        return replace(self, effects=tuple(stated)).add(*self.effects) if stated else self

    def __repr__(self) -> str:
        tool, cell = "" if self.tool is None else f"tool={self.tool!r}", "" if self.cell is None else "in a cell"
        return f"<World: {', '.join(filter(None, [self.robot, tool, cell, *map(repr, self.effects)]))}>"

    def without(self, effect: str, where: str) -> World:
        """Return this world without the effect of that name and place."""
        return self.only(lambda e: (e.effect, e.where) != (effect, where))

    def only(self, wanted: Callable[[EffectInstance], bool]) -> World:
        """Return this world with only those effects for which `wanted` returns True."""
        return replace(self, effects=tuple(filter(wanted, self.effects)))

    @property
    def label(self) -> str:
        """The world as text: `nominal + coulomb_friction(joint4)`."""
        return " + ".join(["nominal", *(e.label for e in self.effects)])

    @property
    def values(self) -> dict[str, dict[str, float]]:
        """Effect's label -> parameter -> value."""
        return {e.label: {name: v.value for name, v in e.params.items()} for e in self.effects}
