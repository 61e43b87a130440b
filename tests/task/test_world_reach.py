"""Every range of every world that comes with the package reaches the physics, the drive, a reading or the belief."""

from __future__ import annotations

import numpy as np
import pytest
from clamped import SCENE, written

from vispeg.core.effect import OPTICAL, EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.sim.placement import activate
from vispeg.sim.state import DriveState
from vispeg.task.world_file import built_in, load_world
from vispeg.worlds.randomized import RandomizedEffect
from vispeg.worlds.world import World

TICKS = 400
ALL = [r for name in built_in() for r in load_world(name).world.ranges]
RANGES = {f"{r.label} {r.params}": r for r in ALL if effect(r.effect).family not in OPTICAL}


def at(r: RandomizedEffect, quantile: float) -> World:
    """The effect with every parameter at this quantile of its range, wherever the range puts it."""
    values = {k: v if isinstance(v, float) else v.at(quantile) for k, v in r.params.items()}
    if "seed" in values:
        values["seed"] = 5.0
    places = effect(r.effect).targets(SCENE) if r.where == "each" else [r.where]
    return World().add(*(EffectInstance.of(r.effect, where, **values) for where in places))


def seen(worlds: list[World]) -> list[list[np.ndarray]]:
    """What each world's effect makes of the model's fields and of the signals that pass its hooks."""
    batch, fields = written(worlds)
    out = [batch.expand(name).copy() for name in sorted(fields.touched)]
    rng, n = stream(1, "reach"), len(worlds)
    for a in activate(SCENE, worlds):
        signal = np.cumsum(np.repeat(rng.standard_normal((TICKS, 1, 7)), n, axis=1), axis=0)
        still = np.zeros((n, 7))
        x = DriveState(1e-3, 5e-3, still, still, still, still, np.ones((n, 7)))
        state, passed = a.effect.start(x, a.p), []
        for value in signal:
            x.q, x.dq = 0.01 * value, value
            if a.effect.overrides("drive"):
                passed.append(a.effect.drive(state, value, x, a.p))
            if a.effect.overrides("observe"):
                passed.append(np.concatenate(a.effect.observe(state, x.q, x.dq, x, a.p), axis=1))
            if a.effect.overrides("torque"):
                passed.append(a.effect.torque(state, x, a.p))
            if a.effect.overrides("friction"):
                passed.append(a.effect.friction(state, x, a.p))
            if a.effect.overrides("wrench"):
                passed.append(a.effect.wrench(state, value[:, :6], x, a.p))
        if passed:
            out.append(np.swapaxes(np.array(passed), 0, 1))
        if a.effect.overrides("believe"):
            out.append(a.effect.believe(np.zeros((n, 3)), a.p))
    return [[values[row] for values in out] for row in range(n)]


@pytest.mark.parametrize("text", sorted(RANGES))
def test_both_ends_and_nominal_are_three_different_worlds(text):
    r = RANGES[text]
    low, high, nominal = seen([at(r, 0.02), at(r, 0.98), World()])
    drawn = any(not isinstance(v, float) for k, v in r.params.items() if k != "seed")
    for one, other in ((low, nominal), (high, nominal), *([(low, high)] if drawn else [])):
        assert any(not np.array_equal(a, b) for a, b in zip(one, other, strict=True)), r
    assert all(np.isfinite(a).all() for a in (*low, *high))


def test_a_fresh_drawn_world_starts_from_nominal_every_time():
    """Drawing is not cumulative: the fields of seed 3 are the same whatever was drawn and written before."""
    world = load_world("randomized").world
    first, _ = written([world.sample(3, SCENE)])
    for seed in range(4):
        written([world.sample(seed, SCENE)])
    again, fields = written([world.sample(3, SCENE)])
    assert len(fields.touched) > 8
    for name in fields.touched:
        np.testing.assert_array_equal(first.expand(name), again.expand(name), err_msg=name)


def test_a_drawn_world_is_the_same_in_any_row():
    world = load_world("randomized").world
    drawn = [world.sample(s, SCENE) for s in (1, 2, 3)]
    together, fields = written(drawn)
    for row, w in enumerate(drawn):
        alone, _ = written([w])
        for name in fields.touched:
            np.testing.assert_array_equal(together.expand(name)[row], alone.expand(name)[0], err_msg=name)
