"""Nominal values of a world's cell, by which measured values are divided for effects that scale them."""

from __future__ import annotations

from typing import Literal

from vispeg.core.errors import UserError
from vispeg.effects.common.parts import body_of, held, shapes, touching
from vispeg.task.registry import scene_of
from vispeg.task.world_file import load_world


def cell_value(what: Literal["mass", "friction"], part: str, world: str) -> float:
    """Return the mass (kg) of a part's body, or its coefficient of sliding friction, in a world's cell.

    Raises:
        UserError: an unknown world or part, or a part without the value.
    """
    scene = scene_of(load_world(world).task)
    parts = touching(scene) if what == "friction" else held(scene)
    if part not in parts:
        raise UserError(f"has no {what} that an effect scales", key="--where", got=part, choices=parts)
    model = scene.compile()
    if what == "mass":
        return float(model.body(body_of(part)).mass[0])
    return float(model.geom_friction[shapes(model, part), 0].max())


def check_part(part: str, world: str) -> None:
    """Check that a part makes contact in a world's cell. Raises UserError: it does not, or an unknown world."""
    parts = touching(scene_of(load_world(world).task))
    if part not in parts:
        raise UserError("no such part", key="--where", got=part, choices=parts)


def held_part(world: str) -> str:
    """Return the part that the gripper holds in a world's cell. Raises UserError: an unknown world."""
    return scene_of(load_world(world).task).held
