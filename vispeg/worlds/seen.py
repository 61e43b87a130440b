"""Which of a world's effects the task's physics feels, and which its cameras see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from vispeg.core.effect import OPTICAL, EffectInstance, effect
from vispeg.worlds.world import RandomizedEffect, World


def shown(world: World, cameras: Sequence[str]) -> World:
    """The world without what no camera of the task can see."""

    def seen(e: EffectInstance | RandomizedEffect) -> bool:
        family = effect(e.effect).family
        if family == "camera":
            return bool(cameras) and e.where in ("all", "each", *cameras)
        return family != "appearance" or bool(cameras)

    effects, ranges = (tuple(e for e in group if seen(e)) for group in (world.effects, world.ranges))
    return replace(world, effects=effects, ranges=ranges)  # type: ignore[arg-type]


def felt(world: World) -> World:
    """The world without what is only seen."""
    return replace(world, effects=tuple(e for e in world.effects if effect(e.effect).family not in OPTICAL))
