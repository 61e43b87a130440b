"""Levels follow what a policy copes with, and nothing else."""

from __future__ import annotations

import json

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.robots.scene import build
from vispeg.worlds.adaptive import Adaptive, Schedule
from vispeg.worlds.distribution import Uniform
from vispeg.worlds.randomized import RandomizedEffect, RandomizedWorld

SCENE = build()
FRICTION = RandomizedEffect("contact_friction", "peg", {"scale": Uniform(0.5, 1.5)})
OFFSET = RandomizedEffect("hole_offset", "fixture", {"x": Uniform(-0.04, 0.04), "y": Uniform(-0.04, 0.04)})
WORLD = RandomizedWorld(ranges=(FRICTION, OFFSET))


def train(adaptive: Adaptive, copes, episodes: int, first: int = 0) -> None:
    """Episodes whose draws are those of `WORLD`, written out: uniform about null, scaled by the level."""
    for seed in range(first, first + episodes):
        levels, rng = dict(adaptive.levels), stream(seed, "episode")
        values = {"contact_friction(peg)": {"scale": 1 + levels[FRICTION.label] * rng.uniform(-0.5, 0.5)}}
        if OFFSET.label in levels:
            values[OFFSET.label] = {axis: levels[OFFSET.label] * rng.uniform(-0.04, 0.04) for axis in "xy"}
        adaptive.record(values, copes(values), levels)


def test_each_level_settles_where_the_policy_ends_to_cope():
    """A policy that stands friction within 0.3 of nominal and any offset: 0.6 of one range, all of the other."""

    def copes(values) -> bool:
        return abs(values["contact_friction(peg)"]["scale"] - 1) <= 0.3

    world = RandomizedWorld(ranges=(FRICTION,))
    adaptive = Adaptive(world, step=0.05)
    train(adaptive, copes, 6000)
    assert 0.55 <= adaptive.levels[FRICTION.label] <= 0.8
    both = Adaptive(WORLD, step=0.05)
    train(both, lambda v: True, 4000)
    assert set(both.levels.values()) == {1.0}
    train(both, lambda v: False, 6000)
    assert set(both.levels.values()) == {0.0}


def test_only_the_edge_counts():
    adaptive = Adaptive(RandomizedWorld(ranges=(FRICTION,)), start=0.5, window=10)
    levels = dict(adaptive.levels)
    for _ in range(200):
        adaptive.record({"contact_friction(peg)": {"scale": 1.1}}, True, levels)
    assert adaptive.levels == levels
    for _ in range(10):
        adaptive.record({"contact_friction(peg)": {"scale": 0.78}}, True, levels)
    assert adaptive.levels[FRICTION.label] == 0.55
    for _ in range(50):  # drawn before the level moved
        adaptive.record({"contact_friction(peg)": {"scale": 0.76}}, True, levels)
    assert adaptive.levels[FRICTION.label] == 0.55


@pytest.mark.parametrize("sign", [1, -1])
def test_of_a_range_beyond_nominal_the_outer_share_counts(sign):
    """Of values 3 to 4 from null, those beyond 3.74 are at the edge at level 1, and half of them at level 1/2."""
    far = RandomizedEffect("joint_bias", "joint4", {"torque": Uniform(*sorted((3.0 * sign, 4.0 * sign)))})
    for level in (0.5, 1.0):
        adaptive = Adaptive(RandomizedWorld(ranges=(far,)), start=level)
        for away in (3.1, 3.6, 3.9):
            adaptive.record({far.label: {"torque": level * away * sign}}, True, dict(adaptive.levels))
        assert adaptive.outcomes == {far.label: [True]}


def test_a_place_with_a_range_to_itself_says_nothing_of_the_broad_one():
    each = RandomizedEffect("viscous_friction", "each", {"damping": Uniform(0.0, 2.0)})
    own = RandomizedEffect("viscous_friction", "joint4", {"damping": Uniform(0.0, 9.0)})
    adaptive = Adaptive(RandomizedWorld(ranges=(each, own)), start=0.5)
    inner, outer = {"damping": 0.1}, {"damping": 4.0}
    adaptive.record({"viscous_friction(joint1)": inner, own.label: outer}, True, dict(adaptive.levels))
    assert adaptive.outcomes == {each.label: [], own.label: [True]}


def test_a_level_of_nought_is_nominal_and_levels_scale_draws():
    for seed in range(20):
        whole, half = WORLD.sample(seed, SCENE), WORLD.sample(seed, SCENE, {FRICTION.label: 0.5, OFFSET.label: 0.0})
        a, b = (w.effects[0].params["scale"].value for w in (whole, half))
        assert b - 1 == pytest.approx(0.5 * (a - 1), abs=1e-15)
        assert [v.value for v in half.effects[1].params.values()] == [0.0, 0.0, 0.0]


def test_state_continues_exactly_through_json():
    def copes(values) -> bool:
        return abs(values["hole_offset(fixture)"]["x"]) < 0.02

    straight, broken = Adaptive(WORLD), Adaptive(WORLD)
    train(straight, copes, 1500)
    train(broken, copes, 700)
    resumed = Adaptive(WORLD)
    resumed.restore(json.loads(json.dumps(broken.state())))
    train(resumed, copes, 800, first=700)
    assert resumed.state() == straight.state()
    with pytest.raises(UserError, match="another world"):
        Adaptive(RandomizedWorld(ranges=(FRICTION,))).restore(broken.state())


def test_schedule_is_linear_between_its_points():
    schedule = Schedule(((0.1, 0.2), (0.5, 1.0)))
    np.testing.assert_allclose([schedule(x) for x in (0, 0.1, 0.3, 0.5, 1)], [0.2, 0.2, 0.6, 1, 1])


@pytest.mark.parametrize("points", [(), ((0.5, 0.0), (0.2, 1.0)), ((0.0, 2.0),), ((0.0, np.nan),)])
def test_a_schedule_that_is_none_is_refused(points):
    with pytest.raises(UserError, match="schedule"):
        Schedule(points)
