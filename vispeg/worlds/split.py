"""Split a world into the effects on its physics and those that only cameras see.

Each effect draws from its own random stream, so the parts of a randomized world draw the same values as the whole.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

from vispeg.core.effect import ARM, OPTICAL, Effect, effect
from vispeg.worlds.places import acts_on
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.world import World

AnyWorld = TypeVar("AnyWorld", World, RandomizedWorld)


def of_arm(world: AnyWorld) -> AnyWorld:
    """Return the world with only those effects that an arm alone can show."""
    return world.only(lambda e: effect(e.effect).family in ARM)


def physical(world: AnyWorld) -> AnyWorld:
    """Return the world without effects that only cameras see."""
    return world.only(lambda e: effect(e.effect).family not in OPTICAL)


def optical(world: AnyWorld, cameras: Sequence[str]) -> AnyWorld:
    """Return the world with only its optical effects; camera effects only if they act on one of these cameras.

    Without cameras, no effects remain.
    """

    def visible(e) -> bool:
        family = effect(e.effect).family
        return family == "appearance" or (family == "camera" and acts_on(e.where, cameras))

    return world.only(lambda e: bool(cameras) and visible(e))


def moving(world: World | RandomizedWorld) -> bool:
    """Return whether an effect of the world needs to know which bodies an image shows (see `CameraEffect.moving`)."""
    entries = world.entries if isinstance(world, RandomizedWorld) else world.effects

    def stated(kind: Effect, params: Mapping[str, object]) -> bool:
        given = {name: params[name] for name in getattr(kind, "moving", ()) if name in params}
        # a fixed effect has a Value, a range a number or distribution
        return any(getattr(value, "value", value) != kind.params[name].null for name, value in given.items())

    return any(stated(effect(e.effect), e.params) for e in entries)
