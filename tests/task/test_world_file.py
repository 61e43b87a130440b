"""World files: what is written is what is drawn, and every mistake is one line that names file, key and choices."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from vispeg.api.fit_paper import PaperFit
from vispeg.api.inputs import read_model
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.render.cameras.camera_files import save_cameras
from vispeg.render.cameras.standard import standard_cameras
from vispeg.robots.model import load
from vispeg.robots.scene import build
from vispeg.sim.export import to_mjcf
from vispeg.sim.placement import activate
from vispeg.task.registry import config_of
from vispeg.task.world_file import LATER, built_in, load_world, world_hash, world_text
from vispeg.worlds import places
from vispeg.worlds.distribution import Normal, Uniform
from vispeg.worlds.measurement_file import Measurement, Quantity, measurement_text
from vispeg.worlds.world import World

SCENE = build()
FRICTION = {"effect": "contact_friction", "where": "peg", "params": {"scale": {"uniform": [0.5, 1.5]}}}
MODEL = """
format: vispeg-model/1
robot: iiwa14
effects:
  - {effect: viscous_friction, where: joint2, params: {damping: {value: 3.0, low: 2.804, high: 3.196, unit: N m s/rad}}}
  - {effect: viscous_friction, where: joint3, params: {damping: {value: 0.1, low: -0.3, high: 0.5, unit: N m s/rad}}}
  - {effect: payload, where: flange, params: {mass: {value: 0.4, unit: kg}}}
"""


def write(path: Path, **data) -> Path:
    path.write_text(yaml.safe_dump({"format": "vispeg-world/1", **data}), encoding="utf-8")
    return path


@pytest.fixture
def world(tmp_path):
    return lambda stem="w", /, **data: write(tmp_path / f"{stem}.yaml", **data)


def values(path, seed: int) -> dict:
    drawn = load_world(path).world.sample(seed, SCENE)
    return {e.label: {k: v.value for k, v in e.params.items()} for e in drawn.effects}


@pytest.mark.parametrize("name", built_in())
def test_every_built_in_world_loads_states_its_sources_and_survives_a_round_trip(name, tmp_path):
    file = load_world(name)
    assert file.name == name and len(file.hash) == 64
    assert all(r.source for r in file.world.ranges), "a range says where it comes from"
    copy = tmp_path / "copy.yaml"
    copy.write_text(world_text(file), encoding="utf-8")
    again = load_world(copy)
    assert again.world == file.world and again.hash == file.hash


def test_a_part_is_a_base_by_name_and_no_world(world):
    made = load_world(world(base=["randomized", "looks", "sensor"]))
    assert made.hash == load_world("S").hash, "S is made of these"
    seen = {r.effect for r in load_world(world("bare", base=["nominal", "looks", "sensor"])).world.ranges}
    assert "part_colour" in seen and "contact_friction" not in seen
    with pytest.raises(UserError, match="unknown world"):
        load_world("looks")


def test_nominal_draws_nothing():
    assert load_world("nominal").world.sample(3, SCENE).effects == ()


def test_ranges_are_drawn_inside_and_by_seed(world):
    path = world(effects=[FRICTION])
    drawn = np.array([values(path, s)["contact_friction(peg)"]["scale"] for s in range(200)])
    assert 0.5 <= drawn.min() < 0.55 and 1.45 < drawn.max() <= 1.5 and abs(drawn.mean() - 1) < 0.08
    assert values(path, 7) == values(path, 7) != values(path, 8)


def test_another_range_leaves_a_draw_as_it_was(world):
    offset = {"effect": "hole_offset", "where": "fixture", "params": {"x": {"uniform": [-0.01, 0.01]}}}
    alone, both = world("a", effects=[FRICTION]), world("b", effects=[offset, FRICTION])
    for seed in range(5):
        assert values(both, seed)["contact_friction(peg)"] == values(alone, seed)["contact_friction(peg)"]


def test_a_seed_that_is_not_given_is_drawn(world):
    path = world(effects=[{"effect": "encoder_noise", "params": {"sd": 0.001}}])
    seeds = {values(path, s)["encoder_noise(all)"]["seed"] for s in range(8)}
    assert len(seeds) == 8


def test_a_group_moves_together_by_its_correlation(world):
    """Correlation of the Gaussian scores is rho (uniform ranges: 6 / pi asin(rho / 2)); a negative rho mirrors."""
    entries = [
        {"effect": e, "where": "peg", "params": {"scale": {"uniform": [0.5, 1.5]}}, "group": "g", "rho": rho}
        for e, rho in (("contact_friction", 0.8), ("object_mass", 0.8), ("contact_damping", -0.8))
    ]
    ranges = load_world(world(effects=entries)).world
    drawn = [ranges.sample(s, SCENE).effects for s in range(400)]
    table = np.array([[e.params["scale"].value for e in effects] for effects in drawn])
    expected = 6 / np.pi * np.arcsin(0.8 / 2)
    got = np.corrcoef(table.T)
    np.testing.assert_allclose([got[0, 1], got[0, 2], got[1, 2]], [expected, -expected, -expected], atol=0.06)


def test_effects_that_all_move_against_their_group_would_move_together_and_are_refused(world):
    grouped = {"params": {"scale": {"uniform": [0.5, 1.5]}}, "where": "peg", "group": "g", "rho": -0.7}
    path = world(effects=[{**grouped, "effect": e} for e in ("contact_friction", "object_mass")])
    with pytest.raises(UserError, match=r"effects\[0\]\.rho: a negative rho without a positive one; .*got -0.7"):
        load_world(path)


def test_chance_is_how_often_an_episode_has_the_effect(world):
    path = load_world(world(effects=[{**FRICTION, "chance": 0.3}]))
    share = np.mean([len(path.world.sample(s, SCENE).effects) for s in range(500)])
    assert abs(share - 0.3) < 0.07


def test_what_was_identified_is_the_centre_and_its_interval_the_width(world, tmp_path):
    (tmp_path / "model.yaml").write_text(MODEL, encoding="utf-8")
    each = {"effect": "viscous_friction", "where": "each", "params": {"damping": {"uniform": [0.0, 1.0]}}}
    own = {"effect": "payload", "where": "flange", "params": {"mass": 0.7}}
    path = world(model="model.yaml", effects=[each, own])
    ranges = {r.label: r for r in load_world(path).world.ranges}
    fitted, bounds = ranges["viscous_friction(joint2)"].params["damping"], effect("viscous_friction").params["damping"]
    assert isinstance(fitted, Normal) and (fitted.low, fitted.high) == (bounds.low, bounds.high)
    assert (fitted.mean, fitted.sd) == (3.0, pytest.approx(0.1))
    drawn = [values(path, s) for s in range(150)]
    second = np.array([d["viscous_friction(joint2)"]["damping"] for d in drawn])
    third = np.array([d["viscous_friction(joint3)"]["damping"] for d in drawn])
    assert abs(second.mean() - 3) < 0.04 and second.std() == pytest.approx(0.1, rel=0.25)
    assert third.min() >= 0, "cut where the effect has its bounds"
    assert max(d["viscous_friction(joint4)"]["damping"] for d in drawn) <= 1.0
    assert {d["payload(flange)"]["mass"] for d in drawn} == {0.7}, "the file's own word for the very place wins"


def test_what_was_identified_wins_over_the_base_at_the_same_place(world, tmp_path):
    (tmp_path / "model.yaml").write_text(MODEL, encoding="utf-8")
    mass = {"effect": "payload", "where": "flange", "params": {"mass": {"uniform": [0.0, 9.0]}}}
    world("broad", effects=[mass, {**mass, "effect": "viscous_friction", "where": "each", "params": {"damping": 0.1}}])
    found = [r for r in load_world(world("both", base="broad.yaml", model="model.yaml")).world.ranges]
    alone = {r.label: r.params for r in load_world(world("alone", model="model.yaml")).world.ranges}
    assert {r.label: r.params for r in found if r.where != "each"} == alone, "and nothing of the base's is left there"
    assert [r.where for r in found][0] == "each", "the wide range comes first, so that the narrow one wins"


@pytest.mark.parametrize("order", [("all", "each"), ("each", "all")])
def test_of_all_and_each_in_one_file_the_later_counts_where_its_chance_lets_it_act(order, world):
    first, last = (
        {"effect": "viscous_friction", "where": where, "params": {"damping": damping}, "chance": chance}
        for where, damping, chance in zip(order, (0.1, 0.2), (1.0, 0.5), strict=True)
    )
    drawn, model = load_world(world("w", effects=[first, last])).world, SCENE
    damping = [
        places.values(effect("viscous_friction"), [drawn.sample(seed, model).effects], model)["damping"]
        for seed in range(20)
    ]
    assert {float(row) for rows in damping for row in rows.ravel()} == {0.1, 0.2}
    assert all(np.ptp(rows) == 0 for rows in damping) or order[1] == "each"  # each joint has its own chance


@pytest.mark.parametrize("where", ["all", "each"])
def test_a_files_word_for_many_places_wins_over_its_bases_for_one(where, world):
    """Of every effect of which `randomized` says something for one place: nothing of that is left in any episode."""
    base = load_world("randomized").world.ranges
    for name in dict.fromkeys(r.effect for r in base if r.where not in ("all", "each")):
        kind = effect(name)
        null = {k: kind.params[k].null for k in kind.magnitudes}
        path = world(f"{name}-{where}", base="randomized", effects=[{"effect": name, "where": where, "params": null}])
        for seed in range(3):
            found = [v for label, v in values(path, seed).items() if label.startswith(f"{name}(")]
            assert found and all(v[k] == null[k] for v in found for k in null), name
    own = world(base="randomized", effects=[{"effect": "hole_offset", "where": where, "params": {"x": 0.01}}])
    assert [v for k, v in values(own, 1).items() if k.startswith("hole_offset")] == [{"x": 0.01, "y": 0.0, "z": 0.0}]


def test_of_one_file_the_narrower_word_wins(world, tmp_path):
    """For one effect and place: the file's own for that place, what was identified, the file's for many, the bases'."""
    (tmp_path / "model.yaml").write_text(MODEL, encoding="utf-8")

    def friction(where, damping):
        return {"effect": "viscous_friction", "where": where, "params": {"damping": damping}}

    world("low", effects=[friction("joint1", 9.0), friction("joint2", 9.0), friction("joint4", 9.0)])
    mine = [friction("joint3", 0.7), friction("each", 0.5)]
    path = world("high", base="low.yaml", model={"file": "model.yaml", "sd": 0, "widen": 0}, effects=mine)
    cell = activate(SCENE, [load_world(path).world.sample(0, SCENE)])
    damping = next(a.p["damping"][0] for a in cell if a.effect.name == "viscous_friction")
    assert damping.tolist() == [0.5, 3.0, 0.7, 0.5, 0.5, 0.5, 0.5]


def test_a_world_builds_on_others_and_replaces_what_it_says_itself(world, tmp_path):
    world("first", task={"clearance_mm": 1.0, "stack": 4}, effects=[FRICTION])
    mine = {**FRICTION, "params": {"scale": 0.8}}
    mass = {"effect": "object_mass", "where": "peg", "params": {"scale": 1.2}}
    file = load_world(world("second", base="first.yaml", task={"clearance_mm": 2.0}, effects=[mass, mine]))
    assert file.task == {"clearance_mm": 2.0, "stack": 4}
    assert {r.label: r.params["scale"] for r in file.world.ranges} == {
        "contact_friction(peg)": 0.8,
        "object_mass(peg)": 1.2,
    }
    both = load_world(world("third", base=["randomized", "second.yaml"]))
    assert {r.label: r.params for r in both.world.ranges}["object_mass(peg)"] == {"scale": 1.2}
    world("loop", base="loop.yaml")
    with pytest.raises(UserError, match="based on itself"):
        load_world(tmp_path / "loop.yaml")


def test_the_text_of_a_world_names_its_camera_files_from_any_folder(world, tmp_path, monkeypatch):
    """As an episode that diverged is saved, wherever the command stood."""
    world("mine", base="nominal", cameras={"external": "lens.yaml"})
    save_cameras(tmp_path / "lens.yaml", standard_cameras()[2].moved(fx=70.0))
    monkeypatch.chdir(tmp_path)
    file = load_world("mine.yaml")
    (tmp_path / "saved").mkdir()
    (tmp_path / "saved" / "world.yaml").write_text(world_text(file), encoding="utf-8")
    assert load_world("saved/world.yaml").hash == file.hash


def test_a_worlds_own_camera_is_a_place_of_its_effects_and_of_those_of_worlds_on_it(world):
    """As one that the task does not use is: what counts is that the world has it."""
    off = {"effect": "camera_offset", "where": "side", "params": {"x": 0.01}}
    mine = world("mine", base="nominal", cameras={"side": {"width": 32}}, effects=[off])
    assert values(mine, 0) == {"camera_offset(side)": {"x": 0.01, "y": 0, "z": 0, "rx": 0, "ry": 0, "rz": 0}}
    other = world("other", base="mine.yaml", effects=[off | {"params": {"y": 0.02}}])
    assert values(other, 0)["camera_offset(side)"]["y"] == 0.02
    with pytest.raises(UserError, match=r"no such place; got 'sied'.*external, side"):
        load_world(world("typo", base="mine.yaml", effects=[off | {"where": "sied"}]))


def test_the_hash_is_of_content_not_of_words(world):
    plain = load_world(world("a", effects=[FRICTION])).hash
    assert load_world(world("b", name="other", about="x", effects=[{**FRICTION, "source": "s"}])).hash == plain
    assert load_world(world("c", effects=[FRICTION], task={"clearance_mm": 3.0})).hash == plain, "3 mm is the default"
    others = [
        {"effects": [{**FRICTION, "params": {"scale": {"uniform": [0.5, 1.4]}}}]},
        {"effects": [{**FRICTION, "chance": 0.5}]},
        {"effects": [FRICTION], "task": {"clearance_mm": 1.0}},
        {"effects": [FRICTION], "renderer": {"backend": "raycast"}},
        {"effects": [FRICTION], "cameras": {"external": {"width": 32}}},
    ]
    hashes = {load_world(world(f"o{i}", **data)).hash for i, data in enumerate(others)}
    assert len(hashes) == len(others) and plain not in hashes
    file = load_world("randomized")
    assert world_hash(file.world, file.task, file.cameras, file.renderer) == file.hash


def test_fields_younger_than_the_hash_enter_it_only_where_they_differ(world, tmp_path):
    """Shipped policies and results carry hashes from before there were such fields."""
    assert load_world("nominal").hash == "9a06a676d4bd6d5e4d616490927c1ef69ee74ea4cef5a4bbeff87c4efeb691ae"
    assert load_world("randomized").hash == "a44f418112dce0f31783affd2f60b92a4df60795c9afa9f7d91884fe5b13829e"
    given = [{"fixture": [0.6, 0, 0.06]}, {"block": 0.06}, {"success_lateral": 0.002}, {"success_force": 50.0}]
    given += [{"reward": "paper"}, {"avoid_limits": 100.0}, {"guard_velocity": 1.0}, {"guard_limit": 0.05}]
    given += [{"guard_singularity": 0.05}, {"distractor_meshes": ["box.stl"]}]
    trimesh.creation.box((0.02, 0.02, 0.02)).export(tmp_path / "box.stl")
    assert {"robot", *(key for task in given for key in task)} == set(LATER) - {
        "name"
    }  # of another task, whose fields differ
    plain = load_world(world()).hash
    same = {"fixture": [0.6, 0, 0.05], "block": 0.05, "success_lateral": 0, "success_force": 0, "reward": "shaped"}
    assert load_world(world("same", task=same)).hash == plain
    hashes = {load_world(world(f"o{i}", task=task)).hash for i, task in enumerate(given)}
    assert len(hashes) == len(given) and plain not in hashes


def test_how_far_an_arm_repeats_decides_no_episode_and_is_not_in_the_hash(tmp_path):
    for robot in ("", "velocity_limit: [1, 1, 1, 1, 1, 1, 1], "):
        hashes = []
        for said in ("", "repeatability: 0.0002"):
            file = tmp_path / "w.yaml"
            file.write_text(f"format: vispeg-world/1\nrobot: {{{robot}{said}}}\n")
            hashes.append(load_world(file).hash)
            assert config_of(load_world(file).task).robot.repeats_mm == (0.2 if said else 0.15)
        assert hashes[0] == hashes[1]


FAR = [
    ({"x": {"uniform": [-0.15, 0.15]}, "y": {"uniform": [0.0, 0.15]}}, "out of reach"),
    ({"x": 0.1, "y": {"uniform": [0.0, 0.15]}}, "the arm cannot reach the hole"),
    ({"x": {"choice": [0.0, 0.15]}, "y": 0.05}, "out of reach"),
    ({"z": {"uniform": [-0.06, 0.0]}}, "0.045 to 0.4 m high"),
    ({"z": {"normal": [0.0, 0.01]}}, "0.045 to 0.4 m high"),
    ({"z": -0.1}, "0.045 to 0.4 m high"),
]


@pytest.mark.parametrize(("params", "says"), FAR)
def test_a_hole_out_of_reach_is_refused(params, says, world):
    path = world("far", effects=[FRICTION, {"effect": "hole_offset", "where": "fixture", "params": params}])
    for file in (path, world("above", base="far.yaml")):
        with pytest.raises(UserError) as error:
            load_world(file)
        text = str(error.value)
        assert text.startswith(f"{path}: effects[1]: ") and says in text and "\n" not in text, text


def test_reach_is_judged_by_what_the_whole_file_says(world):
    """A fixture aside, where joint 7 would have to turn too far; an offset that only another fixture's place allows."""
    with pytest.raises(UserError, match=r"side.yaml: task.fixture: .*the arm cannot reach the hole"):
        load_world(world("side", task={"fixture": [0.42, 0.42, 0.05]}))
    low = {"effect": "hole_offset", "where": "all", "params": {"z": {"uniform": [-0.05, 0.0]}}}
    load_world(world("raised", task={"fixture": [0.6, 0.0, 0.12]}, effects=[low]))
    near = {"effect": "hole_offset", "where": "all", "params": {"y": {"uniform": [-0.1, 0.1]}}}
    load_world(world("near", task={"fixture": [0.55, 0.0, 0.05]}, effects=[near]))
    world("offset", effects=[low])
    load_world(world("both", base="offset.yaml", task={"fixture": [0.6, 0.0, 0.12]}))


WRONG = {
    "unknown effect": ({"effect": "contact_frictoin"}, "effects[0].effect", "did you mean 'contact_friction'"),
    "unknown place": ({"where": "pegg"}, "effects[0].where", "choices: peg, fixture, gripper, table, all, each"),
    "unknown parameter": ({"params": {"scal": 1.0}}, "effects[0].params.scal", "choices: scale"),
    "inverted": ({"params": {"scale": {"uniform": [2, 1]}}}, "effects[0].params.scale", "low <= high"),
    "NaN": ({"params": {"scale": {"uniform": [0.5, float("nan")]}}}, "effects[0].params.scale", "a finite number"),
    "fixed NaN": ({"params": {"scale": float("nan")}}, "effects[0].params.scale", "a finite number"),
    "three numbers": ({"params": {"scale": {"uniform": [1, 2, 3]}}}, "effects[0].params.scale", "two numbers"),
    "out of bounds": ({"params": {"scale": {"uniform": [0.5, 9]}}}, "effects[0].params.scale", "0 to 5 1"),
    "mean out of bounds": ({"params": {"scale": {"normal": [9, 1]}}}, "effects[0].params.scale", "0 to 5 1"),
    "one choice out": ({"params": {"scale": {"choice": [1, -1]}}}, "effects[0].params.scale", "0 to 5 1"),
    "negative sd": ({"params": {"scale": {"normal": [1, -1]}}}, "effects[0].params.scale", "below 0"),
    "log of nought": ({"params": {"scale": {"log_uniform": [0, 1]}}}, "effects[0].params.scale", "above 0"),
    "unknown law": ({"params": {"scale": {"gauss": [1, 1]}}}, "effects[0].params.scale", "log_uniform"),
    "nothing": ({"params": {}}, "effects[0].params", "one or more of scale"),
    "chance": ({"chance": 1.5}, "effects[0].chance", "0 to 1"),
    "rho alone": ({"rho": 0.5}, "effects[0].rho", "group: NAME"),
    "rho against nothing": ({"rho": -0.7, "group": "g"}, "effects[0].rho", "with a positive rho"),
    "rho": ({"rho": 2, "group": "g"}, "effects[0].rho", "-1 to 1"),
    "key": ({"when": "now"}, "effects[0].when", "choices: effect, where, params"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_entry_is_one_clear_line(case, world):
    change, key, says = WRONG[case]
    path = world(effects=[{**FRICTION, **change}])
    with pytest.raises(UserError) as error:
        load_world(path)
    text = str(error.value)
    assert str(path) in text and key in text and says in text and "\n" not in text, text


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ({"format": "vispeg-model/1"}, "vispeg-world/1"),
        ({"effect": []}, "did you mean 'effects'"),
        ({"task": {"clearence_mm": 1}}, "clearance_mm"),
        ({"task": {"clearance_mm": -1}}, "impossible geometry"),
        ({"effects": {}}, "a list"),
        ({"task": []}, "a mapping"),
        ({"effects": [FRICTION, FRICTION]}, "given twice"),
        (
            {"effects": [FRICTION | {"where": "all"}, FRICTION | {"where": "each"}]},
            "effects[1]: contact_friction(each) leaves nothing of contact_friction(all)",
        ),
        ({"effects": ["contact_friction"]}, "a mapping"),
        ({"base": "randomised"}, "did you mean 'randomized'"),
        ({"model": "nowhere.yaml"}, "nowhere.yaml: no such file"),
        ({"cameras": {"external": 3}}, "a camera file"),
        ({"cameras": {"external": "nowhere.yaml"}}, "no such camera file"),
        (
            {"cameras": {"external": {"wdth": 64}}},
            "cameras.external.wdth: unknown key; got 'wdth' (did you mean 'width'?)",
        ),
        ({"cameras": {"mine": {"width": "64"}}}, "cameras.mine: camera 'mine' has an impossible width"),
        ({"cameras": {"mine": {"name": "other"}}}, "cameras.mine.name: unknown key"),
        ({"renderer": {"backend": "opengl"}}, "raycast"),
        ({"renderer": {"shadows": 1}}, "true"),
        ({"name": 3}, "a text"),
    ],
)
def test_a_wrong_file_is_one_clear_line(data, says, world):
    path = world(**data)
    with pytest.raises(UserError) as error:
        load_world(path)
    text = str(error.value)
    assert str(path.parent) in text and says in text and "\n" not in text, text


def test_names_and_files_that_are_not_there():
    with pytest.raises(UserError, match="did you mean 'nominal'"):
        load_world("nominall")
    with pytest.raises(UserError, match="no such file"):
        load_world("nowhere.yaml")


def test_yaml_that_is_none_and_a_range_as_a_distribution(tmp_path, world):
    bad = tmp_path / "bad.yaml"
    bad.write_text("format: [", encoding="utf-8")
    with pytest.raises(UserError, match="is not YAML"):
        load_world(bad)
    (r,) = load_world(world(effects=[FRICTION])).world.ranges
    assert r.params == {"scale": Uniform(0.5, 1.5)}


def test_a_model_is_widened_by_what_the_file_states(world, tmp_path):
    """sd^2 = (2 x the fit's)^2 + (0.3 x distance from null)^2, in draws too; without an interval the share is left."""
    friction = {"torque": {"value": 1.2, "low": 1.0, "high": 1.4}}
    delay = {"delay": {"value": 0.01}}
    entries = [
        {"effect": "coulomb_friction", "where": "joint4", "params": friction},
        {"effect": "command_delay", "where": "all", "params": delay},
    ]
    model = {"format": "vispeg-model/1", "robot": "iiwa14", "tool": "none", "effects": entries}
    (tmp_path / "model.yaml").write_text(yaml.safe_dump(model), encoding="utf-8")
    wide = load_world(world("wide", model={"file": "model.yaml", "widen": 0.3, "sd": 2})).world
    sds = {r.label: [p.sd for p in r.params.values() if not isinstance(p, float)] for r in wide.ranges}
    assert sds["coulomb_friction(joint4)"] == [pytest.approx(np.hypot(2 * 0.4 / 3.92, 0.3 * 1.2))]
    assert sds["command_delay(all)"] == [pytest.approx(0.003)]
    drawn = [wide.sample(s, SCENE).values["command_delay(all)"]["delay"] for s in range(800)]
    assert np.mean(drawn) == pytest.approx(0.01, abs=4e-4) and np.std(drawn) == pytest.approx(0.003, rel=0.1)
    with pytest.warns(UserWarning, match=r"command_delay\(all\) has no interval for delay"):
        load_world(world("plain", model="model.yaml"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        meant = load_world(world("meant", model={"file": "model.yaml", "widen": 0}))
    assert meant.hash == load_world(world("again", model={"file": "model.yaml", "widen": 0.0})).hash
    for stated, words in (({"widen": 1}, "model"), ({"file": "model.yaml", "wide": 1}, "widen")):
        with pytest.raises(UserError, match=words):
            load_world(world("wrong", model=stated))


@pytest.fixture
def own(tmp_path):
    """A folder with a user's own arm, a fit's folder with its model, and a world of both."""
    (tmp_path / "rig").mkdir()
    (tmp_path / "rig" / "arm.xml").write_text(to_mjcf(World("iiwa14")).xml)
    write(tmp_path / "rig" / "w.yaml", name="mine", base="nominal", robot="arm.xml", model="out/model.yaml")
    return tmp_path / "rig"


def test_a_model_of_ones_own_arm_is_the_worlds_from_any_folder(own, monkeypatch):
    """The fit names the robot as typed beside it; the world is then asked for from there and from elsewhere."""
    found = World("arm.xml").add(EffectInstance.of("viscous_friction", "joint4", damping=1.0))
    monkeypatch.chdir(own)
    PaperFit({}, found, found.effects, {}).save("out")
    measured = Measurement(
        "friction", "joint4", (Quantity("a", 1.0, "1", 0.1, None, 2.0, 0.8, 1.2, "gum"),), found.effects
    )
    (own / "out" / "m.yaml").write_text(measurement_text(replace(measured, robot="../arm.xml")))
    write(own / "m.yaml", name="measured", base="nominal", robot="arm.xml", model="out/m.yaml")
    hashes = {load_world(name).hash for name in ("w.yaml", own / "w.yaml")}
    load_world("m.yaml")
    monkeypatch.chdir(own.parent)
    assert {load_world(name).hash for name in ("rig/w.yaml", own / "w.yaml")} == hashes and len(hashes) == 1
    load_world("rig/m.yaml")
    model = read_model(str(own / "out" / "model.yaml"))
    assert load(model.robot) is load(own / "arm.xml")


def test_an_effect_of_servos_is_refused_as_an_entry_and_left_out_of_a_model(world, tmp_path):
    entry = {"effect": "dead_band", "where": "joint2", "params": {"width": 0.01}}
    friction = {"effect": "coulomb_friction", "where": "joint2", "params": {"torque": 1.0}}
    (tmp_path / "m.yaml").write_text(
        yaml.safe_dump({"format": "vispeg-model/1", "robot": "iiwa14", "effects": [entry, friction]})
    )
    with pytest.raises(UserError, match=r"effects\[0\].effect: .* would change nothing"):
        load_world(world(name="n", base="nominal", effects=[entry]))
    with pytest.warns(UserWarning, match=r"m.yaml: dead_band\(joint2\) left out: a servo's loop takes angles"):
        file = load_world(world(name="n", base="nominal", model="m.yaml"))
    assert [r.label for r in file.world.ranges] == ["coulomb_friction(joint2)"]
