"""Which of a world's effects the task's physics feels, and which its cameras see.

Each effect draws from a stream of its own, so the two parts of a randomized world draw apart what they draw together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from vispeg.core.effect import ARM, OPTICAL, effect
from vispeg.worlds.places import acts_on
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.world import World

AnyWorld = TypeVar("AnyWorld", World, RandomizedWorld)


def of_arm(world: AnyWorld) -> AnyWorld:
    """Return the effects of a world that an arm alone can show."""
    return world.only(lambda e: effect(e.effect).family in ARM)


def physical(world: AnyWorld) -> AnyWorld:
    """Return the world without what is only seen."""
    return world.only(lambda e: effect(e.effect).family not in OPTICAL)


def optical(world: AnyWorld, cameras: Sequence[str]) -> AnyWorld:
    """Return the optical effects of a world, limited to these cameras; empty without a camera."""

    def visible(e) -> bool:
        family = effect(e.effect).family
        return family == "appearance" or (family == "camera" and acts_on(e.where, cameras))

    return world.only(lambda e: bool(cameras) and visible(e))
