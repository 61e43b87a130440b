"""A compiled scene whose fields looks can be written to, and worlds of looks."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.render.look import Fields
from vispeg.robots.scene import Scene, build
from vispeg.worlds.world import World

SCENE: Scene = build()


@lru_cache
def nominal() -> mujoco.MjModel:
    return SCENE.compile()


class Touched(Fields):
    """The fields of a model, and the names of those that were asked for."""

    def __init__(self, model: mujoco.MjModel):
        super().__init__(model, SCENE)
        self.touched = set[str]()

    def __getitem__(self, name: str) -> np.ndarray:
        self.touched.add(name)
        return super().__getitem__(name)


def field(model: mujoco.MjModel, name: str) -> np.ndarray:
    value: Any = model
    for part in name.split("."):
        value = getattr(value, part)
    return value


def written(placed: list[EffectInstance], model: mujoco.MjModel | None = None) -> Touched:
    """The fields of a copy of the nominal model after these effects, in their order."""
    import copy

    fields = Touched(copy.copy(model or nominal()))
    for name in sorted({q.effect for q in placed}, key=lambda n: (effect(n).order, n)):
        kind = effect(name)
        targets = kind.targets(SCENE)
        p = {k: np.full((1, len(targets)), v.start if v.shape else v.null) for k, v in kind.params.items()}
        for one in (q for q in placed if q.effect == name):
            for k, value in one.params.items():
                p[k][0, slice(None) if one.where == "all" else targets.index(one.where)] = value.value
        kind.write(fields, p)
    return fields


def dressed(world: World) -> mujoco.MjModel:
    """The nominal model in a sampled world's looks."""
    return written([q for q in world.effects if effect(q.effect).family == "appearance"]).model
