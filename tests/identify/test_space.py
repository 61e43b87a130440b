"""The vector that an optimizer moves in: there and back, inside the bounds, and nothing else moved."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vispeg.core.effect import EffectInstance, searchable
from vispeg.identify.space import Space
from vispeg.worlds.world import World

REGISTRY = searchable()  # what an arm alone can show

PLACES = {"payload": "flange", "gravity_tilt": "base", "link_mass": "link3", "link_com": "link3"}


def everything() -> World:
    """All effects at their start, one place each."""
    worlds = [
        EffectInstance.of(n, PLACES.get(n, "joint3"), **{k: p.start for k, p in e.params.items()})
        for n, e in REGISTRY.items()
    ]
    return World().add(*worlds)


@given(st.lists(st.floats(0, 1), min_size=60, max_size=60))
def test_coordinates_round_trip(shares):
    """Any point inside the bounds comes back from the world that it stands for."""
    space = Space(everything(), range(len(REGISTRY)))
    low, high = space.bounds
    u = low + np.resize(shares, len(low)) * (high - low)
    again = Space(space.at(u), range(len(REGISTRY))).start
    np.testing.assert_allclose(again, u, atol=1e-9, rtol=1e-9)


@given(st.integers(0, len(REGISTRY) - 1), st.floats(-1e6, 1e6))
def test_worlds_stay_inside_the_bounds(index, far):
    """However far the optimizer leaps, every parameter of the world is one that the effect allows."""
    world = everything()
    space = Space(world, [index])
    moved = space.at(np.full(len(space.axes), np.clip(far, -500, 500))).effects[index]
    for key, param in REGISTRY[moved.effect].params.items():
        assert param.low <= moved.params[key].value <= param.high


def test_only_free_effects_move():
    world = everything()
    space = Space(world, [2, 5])
    moved = space.at(space.start + 0.01)
    for i, (before, after) in enumerate(zip(world.effects, moved.effects, strict=True)):
        assert (before == after) == (i not in (2, 5)), before.label
    assert {a.index for a in space.axes} == {2, 5}
    assert world == everything()


def test_steps_stay_inside_the_bounds():
    """At both bounds and between, a difference step leads to a legal point, and not to the same one."""
    space = Space(everything(), range(len(REGISTRY)))
    low, high = space.bounds
    for u in (low, high, 0.5 * (low + high)):
        moved = u + space.steps(u)
        assert ((moved >= low) & (moved <= high)).all()
        assert (moved != u).all()


def test_a_step_on_a_log_axis_is_a_share():
    world = World().add(EffectInstance.of("cogging", "joint1", amplitude=0.3, poles=12.0, phase=0.0))
    space = Space(world, [0])
    poles = [a.name for a in space.axes].index("poles")
    u = space.start
    u[poles] += np.log(1.1)
    assert np.isclose(space.at(u).effects[0].params["poles"].value, 13.2)
