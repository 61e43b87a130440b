"""Recover the true wrench from the readings of a force sensor with a world's sensor effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.contact.path import Path
from vispeg.core.effect import effect
from vispeg.identify.channels import shows
from vispeg.recordings.cell import reaction
from vispeg.worlds.world import World

REACH = 0.8  # m, converts joint angles to the flange's position


def hand_world(believed: World, world: World) -> World:
    """Return the believed cell with the effects of a world that change a wrench."""
    return believed.add(*world.effects).only(lambda e: shows(effect(e.effect), "wrench"))


def true_wrench(path: Path, world: World) -> np.ndarray:
    """Return the true wrench on the tool (n, 6) N, N m: the readings without the world's sensor errors."""
    wrench = reaction(path.wrench)
    placed = [(effect(e.effect), e.params) for e in world.effects]
    for kind, params in sorted(placed, key=lambda p: -p[0].order):
        if kind.overrides("wrench"):
            wrench = kind.unread(wrench, path.step, {k: v.value for k, v in params.items()})
    return reaction(wrench)


def true_per_read(path: Path, world: World) -> float:
    """Return the change of the true force, N, per newton by which a constant reading changes."""
    if not any(effect(e.effect).overrides("wrench") for e in world.effects):
        return 1.0
    constant = replace(path, wrench=np.ones_like(path.wrench))
    change = true_wrench(replace(path, wrench=2 * constant.wrench), world) - true_wrench(constant, world)
    return float(change.mean())
