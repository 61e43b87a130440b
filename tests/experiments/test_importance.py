"""What a factor of randomization is worth: worlds without one, the same states in all, tables of hand-made results."""

import numpy as np
import pytest
from importance import BASE, FACTORS, factor_of, factors, world_without
from importance_tables import factor_left, farther, lost, not_trained, order, points
from same_states import pictured
from transfer_table import success_table

from vispeg.core.effect import effect
from vispeg.evaluation.records import Episode
from vispeg.robots.scene import build
from vispeg.task.world_file import load_world
from vispeg.worlds.randomized import RandomizedWorld

SCENE = build()


def drawn(world, seed=3):
    """Effects of an episode's world that a camera sees, by name and place."""
    some = RandomizedWorld.of(load_world(world).world).sample(seed, SCENE)
    seen = [e for e in some.effects if effect(e.effect).family in ("appearance", "camera")]
    return {(e.effect, e.where): {k: v.value for k, v in e.params.items()} for e in seen}


def test_everything_that_the_training_world_varies_in_pictures_belongs_to_one_factor():
    names = {e for e, _ in drawn(BASE)}
    assert {factor_of(name) for name in names} == set(factors())
    assert all(sum(name in some for some in FACTORS.values()) <= 1 for name in names)


@pytest.mark.parametrize("factor", factors())
def test_a_world_without_a_factor_draws_all_others_as_before(factor, tmp_path):
    before, after = drawn(BASE), drawn(world_without((factor,), tmp_path, f"no-{factor}"))
    for (name, where), values in after.items():
        if factor_of(name) == factor:
            nulls = {k: p.null for k, p in effect(name).params.items() if not p.shape}
            assert values == pytest.approx({k: nulls.get(k, v) for k, v in values.items()})
        else:
            assert values == before[name, where]
    assert {key for key in before if factor_of(key[0]) != factor} <= set(after)


def episodes(policy, train_seed, outcomes):
    return [
        Episode(policy, "depth", train_seed, "V", "abc", 100 + i, bool(y), "success" if y else "jam")
        for i, y in enumerate(outcomes)
    ]


def test_lost_is_what_the_policy_with_everything_has_more_worst_first():
    whole, little, much = [1] * 18 + [0] * 2, [1] * 17 + [0] * 3, [1] * 8 + [0] * 12
    # names before and after `everything` in the alphabet, so that both signs of a comparison come up
    given = [*episodes("depth-a", 1, much), *episodes("rgb-no-lights", 1, much)]
    for seed in (1, 2, 3):
        given += episodes("depth-everything", seed, whole) + episodes("depth-no-lights", seed, little)
        given += episodes("depth-no-camera", seed, much)
    table = success_table([*given, *episodes("depth-nothing", 1, [0] * 20)], "V")
    for turned in (table, {**table, "comparisons": [turn(c) for c in table["comparisons"]]}):
        rows = lost(turned, "depth")
        assert [row["factor"] for row in rows] == ["all of them", "camera", "lights"]
        assert [row["costs"] for row in rows] == pytest.approx([0.9, 0.5, 0.05])
        assert all(row["low"] < row["costs"] < row["high"] for row in rows)
        # one discordant episode in each of three seeds says little, ten in each say much
        assert rows[2]["low"] < 0 < rows[1]["low"] and rows[1]["p"] < 0.01
    assert lost(table, "rgb") == []  # nothing to compare with yet


def turn(c):
    d = c["difference"]
    back = {"value": -d["value"], "low": -d["high"], "high": -d["low"]}
    return {**c, "first": c["second"], "second": c["first"], "difference": back}


def test_farther_holds_the_true_difference_and_is_wider_with_training_seeds_that_differ():
    rng, held, widths = np.random.default_rng(0), [], []
    for spread in (0.0, 1.0):
        for _ in range(150):
            rows = rng.normal(5.0, 2.0, 16)  # some states are hard for every policy
            noise = [rows + spread * rng.standard_normal((3, 1)) + rng.normal(0, 0.5, (3, 16)) for _ in range(2)]
            (row,) = farther({"rgb-everything": noise[0], "rgb-no-noise": noise[1] + 1.5}, "rgb")
            held.append(row["low"] <= 1.5 <= row["high"])
            widths.append(row["high"] - row["low"])
    assert row["factor"] == "noise"
    assert 0.9 < np.mean(held[:150]) and 0.9 < np.mean(held[150:])
    assert np.median(widths[150:]) > 2 * np.median(widths[:150])


def test_the_table_has_a_dash_where_a_policy_is_not_trained_yet():
    one = [{"factor": "camera", "costs": 0.124, "low": -0.05, "high": 0.3}]
    text = order({"depth, V": one, "rgb, V": []}, ["lights", "camera"], points).splitlines()
    assert text[0] == "| left out | depth, V | rgb, V |" and text[2] == "| lights | - | - |"
    assert text[3] == "| camera | +12 (-5 to +30) | - |"
    said = not_trained({1: [], 2: ["rgb-no-noise"], 3: ["a", "b"]}, 2)
    assert said == "Not trained yet: seed 2: rgb-no-noise; seed 3: all.\n" and "none" in not_trained({1: []}, 2)
    assert factor_left("depth-no-lights", "rgb") == "" and factor_left("rgb-everything", "rgb") == ""


def test_states_are_the_same_in_all_worlds_and_only_the_pictures_of_one_factor_differ(tmp_path):
    places = {"all": BASE, "again": BASE, "plain": world_without(factors(), tmp_path, "nothing")}
    rings = pictured(places, "state-3mm-randomized", 5, 2, 3)
    everything, again, plain = rings.values()
    pictures = {key for key in everything.obs if key.startswith(("rgb_", "depth_"))}
    for key, stored in everything.obs.items():
        assert np.array_equal(stored, again.obs[key]) and len(again) == len(everything) > 0
        assert np.array_equal(stored, plain.obs[key]) != (key in pictures), key
    assert np.array_equal(everything.action, plain.action) and np.abs(everything.action).max() > 0
