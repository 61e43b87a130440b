"""Start values of distant effects, which change nothing near null, so that a fit cannot start there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.evidence.localise import joint_data, missing_torque
from vispeg.diagnosis.evidence.signatures import guessed
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import squares
from vispeg.worlds.world import World


def with_start_values(evidence: Evidence, world: World, asked: Sequence[int]) -> World:
    """Return the world with start values for its distant effects (`Effect.distant`) in joints.

    Joint by joint, all combinations of present and guessed values of the joint's distant effects are simulated; the one
    with the smallest residual is taken.

    Args:
        evidence: the recordings to which the world will be fitted.
        world: the world.
        asked: indices of the effects that may change; others than distant ones in joints stay.
    """
    joints = evidence.items[0].robot.joints
    places = {i: world.effects[i].where for i in asked if effect(world.effects[i].effect).distant}
    for joint in (j for j in joints if j in places.values()):
        here = [i for i, where in places.items() if where == joint]
        predicted = evidence.simulated([world])
        missing = [missing_torque(item, y[0]) for item, y in zip(evidence.items, predicted, strict=True)]
        data = joint_data(missing, evidence.items)
        guesses = [guessed(world.effects[i].effect, joint, evidence.items[0], data) for i in here]
        options = [[world.effects[i], *others] for i, others in zip(here, guesses, strict=True)]
        worlds = [_with(world, here, placed) for placed in product(*options)]
        squared = [squares(r) for r in evidence.each_residual(worlds)]
        world = worlds[int(np.argmin(squared))]
    return world


def _with(world: World, at: Sequence[int], placed: Sequence[EffectInstance]) -> World:
    """Return the world with other effects at these indices."""
    effects = list(world.effects)
    for i, e in zip(at, placed, strict=True):
        effects[i] = e
    return replace(world, effects=tuple(effects))
