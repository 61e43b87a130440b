"""`vispeg add`: a model file grows or changes by exactly what was asked."""

import re

import pytest

from vispeg.api.add import add
from vispeg.core.effect import effect
from vispeg.robots.model import load
from vispeg.worlds.model_file import load_model
from vispeg.worlds.places import values


def test_add_then_replace_then_keep(vispeg, tmp_path):
    assert vispeg("add", "iiwa14", "stribeck_friction", "joint4", "--set", "coulomb=1.5", "--out", "a.yaml")[0] == 0
    code, out, _ = vispeg("add", "a.yaml", "payload", "flange", "--set", "mass=0.6", "z=0.07", "--out", "b.yaml")
    assert code == 0 and "stribeck_friction(joint4) + payload(flange)" in out
    assert vispeg("add", "b.yaml", "stribeck_friction", "joint4", "--set", "velocity=0.1", "--out", "c.yaml")[0] == 0
    a, b, c = (load_model(tmp_path / f"{name}.yaml") for name in "abc")
    assert [e.label for e in a.effects] == ["stribeck_friction(joint4)"]
    assert b.effects[0] == a.effects[0]
    assert {k: v.value for k, v in b.effects[1].params.items()}.items() >= {"mass": 0.6, "z": 0.07}.items()
    was, now = b.effects[0].params, c.effects[0].params
    assert len(c.effects) == 2 and c.effects[1] == b.effects[1]
    assert now["velocity"].value == pytest.approx(0.1) and now["coulomb"] == was["coulomb"]


@pytest.mark.parametrize("settings", ["mass=0.6 z=0.07", ["mass=0.6", "z=0.07"]])
def test_values_in_one_text_or_each_in_its_own(tmp_path, settings):
    (payload,) = add("iiwa14", "payload", tmp_path / "a.yaml", where="flange", settings=settings).added
    assert (payload.params["mass"].value, payload.params["z"].value) == (0.6, 0.07)


def test_one_place_of_all(vispeg, tmp_path):
    """What is stated of one joint acts there, whether or not the model has the effect in all; the rest stays."""
    asked = [
        ("joint4", ["excess=2"]),
        ("all", ["coulomb=1", "velocity=0.2"]),
        ("joint4", ["excess=3"]),
        ("joint5", ["excess=4"]),
    ]
    model = "iiwa14"
    for where, stated in asked:
        args = [model, "stribeck_friction", where, "--set", *stated, "--out", "m.yaml", "--overwrite"]
        assert vispeg("add", *args)[0] == 0
        model = "m.yaml"
    p = values(effect("stribeck_friction"), [load_model(tmp_path / model).effects], load("iiwa14"))
    assert p["excess"].tolist() == [[0, 0, 0, 3, 4, 0, 0]]
    assert p["coulomb"].tolist() == [[1] * 7] and p["velocity"].tolist() == [[0.2] * 7]


def test_the_given_file_is_not_touched(vispeg, refused, tmp_path):
    vispeg("add", "iiwa14", "joint_bias", "joint1", "--set", "torque=1", "--out", "m.yaml")
    before = (tmp_path / "m.yaml").read_bytes()
    refused(["add", "m.yaml", "payload", "flange", "--out", "m.yaml"], "exists already")
    assert (tmp_path / "m.yaml").read_bytes() == before
    assert vispeg("add", "m.yaml", "payload", "flange", "--out", "m.yaml", "--overwrite")[0] == 0
    assert len(load_model(tmp_path / "m.yaml").effects) == 2


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["iiwa14", "payloads", "flange"], ["unknown effect", "did you mean 'payload'"]),
        (["iiwa14", "payload", "joint4"], ["no such place", "flange"]),
        (["iiwa14", "cogging", "joint8"], ["no such place", "joint7"]),
        (["iiwa14", "payload", "flange", "--set", "mas=1"], ["no such parameter", "'mass'"]),
        (["iiwa14", "payload", "flange", "--set", "mass=99"], ["out of bounds", "15 kg"]),
        (["iiwa14", "payload", "flange", "--set", "mass=nan"], ["out of bounds"]),
        (["iiwa14", "payload", "flange", "--set", "mass"], ["name=number"]),
        (["iiwa15", "payload", "flange"], ["unknown robot", "iiwa14"]),
        (["gone.yaml", "payload", "flange"], ["gone.yaml: no such file"]),
    ],
)
def test_mistakes(refused, args, words):
    refused(["add", *args, "--out", "m.yaml"], *words)


def test_out_must_be_a_model_file(refused):
    refused(["add", "iiwa14", "payload", "flange", "--out", "m.json"], "--out", ".yaml")


def test_a_cell_has_its_cameras(vispeg, refused, tmp_path):
    assert vispeg("add", "peg-cell", "depth_scale", "wrist_wide", "--set", "factor=1.01", "--out", "a.yaml")[0] == 0
    assert vispeg("add", "a.yaml", "coulomb_friction", "joint4", "--set", "torque=1", "--out", "b.yaml")[0] == 0
    (seen, felt) = load_model(tmp_path / "b.yaml").effects
    assert seen.label == "depth_scale(wrist_wide)" and felt.label == "coulomb_friction(joint4)"
    refused(["add", "b.yaml", "depth_scale", "wrist", "--out", "c.yaml"], "did you mean 'wrist_wide'")


def test_an_effect_of_all_cameras_is_no_camera_named_all(vispeg):
    assert vispeg("add", "peg-cell", "depth_scale", "all", "--set", "factor=1.01", "--out", "a.yaml")[0] == 0
    code, _, said = vispeg("add", "a.yaml", "depth_scale", "nowhere", "--out", "b.yaml")
    assert code == 2 and "external" in said and len(re.findall(r"\ball\b", said)) == 1


def test_an_unknown_key_of_a_parameter_is_one_line(vispeg, tmp_path):
    text = "format: vispeg-model/1\neffects:\n  - effect: coulomb_friction\n    where: joint4\n    params: {torque: "
    (tmp_path / "m.yaml").write_text(text + "{value: 1.2, low: 1.0, hgih: 1.4}}\n")
    code, _, said = vispeg("compare", "m.yaml", "--recording", "none", "--out", "out")
    assert (
        code == 2 and "effects[0].params.torque.hgih: unknown key" in said and "choices: value, low, high, unit" in said
    )
