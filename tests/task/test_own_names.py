"""A task of a user's own whose bodies, sites and joints are called otherwise: effects find them, pictures show them."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance, effect
from vispeg.datasets.formats.registry import export
from vispeg.sim.compiled import compiled
from vispeg.task.cell import Cell
from vispeg.task.registry import config_of, task_of
from vispeg.worlds.world import World

EXAMPLE = Path(__file__).resolve().parents[2] / "docs/examples/snap_fit"
WORLD = """format: vispeg-world/1
name: rod
task: {name: "rod:Rod"}
effects:
  - {effect: contact_friction, where: rod, params: {scale: {uniform: [0.9, 1.1]}}}
  - {effect: object_mass, where: rod, params: {scale: {uniform: [0.9, 1.1]}}}
  - {effect: gripper_slip, where: rod, params: {grip: {uniform: [0.9, 1.1]}}}
  - {effect: distractors, params: {count: 3, size: 1.0, seed: 4}}
"""


MODULE = '''"""The example's task in a cell in which nothing is called as in the package's."""

from dataclasses import replace
from functools import lru_cache

from snap_fit import SnapFit


@lru_cache
def renamed(scene):
    spec = scene.spec()
    for element, name in (
        (spec.body("peg"), "rod"),
        (spec.body("fixture"), "socket"),
        (spec.site("hole"), "mouth"),
        (spec.site("peg_tip"), "end"),
        (spec.joint("peg_slip"), "rod_slip"),
    ):
        element.name = name
    parts = {{"peg": "rod", "fixture": "socket"}.get(name, name): geoms for name, geoms in scene.parts.items()}
    names = {"held": "rod", "fixture": "socket", "goal": "mouth", "tip_site": "end", "slip": "rod_slip"}
    return replace(scene, build=spec.copy, parts=parts, **names)


class Rod(SnapFit):
    label = "rod"

    def cell(self, config, cameras=None):
        return renamed(super().cell(config, cameras))
'''


@pytest.fixture
def rod(monkeypatch, tmp_path):
    """The task's name; its module is where processes of the renderer find it too."""
    (tmp_path / "rod.py").write_text(MODULE)
    for folder in (EXAMPLE, tmp_path):
        monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(EXAMPLE), str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    return "rod:Rod"


def test_effects_act_on_the_parts_by_the_names_of_their_cell(rod):
    config = config_of({"name": rod})
    scene = task_of(config).cell(config)
    assert effect("object_mass").targets(scene) == ["rod"] == effect("gripper_slip").targets(scene)
    assert effect("contact_friction").targets(scene)[:2] == ["rod", "socket"]
    assert effect("hole_offset").targets(scene) == ["socket"] == effect("hole_tilt").targets(scene)
    assert effect("grip_pose").targets(scene) == ["rod"] and effect("goal_imprecision").targets(scene) == ["mouth"]
    assert not effect("hole_clearance").targets(scene), "it moves the walls of the first task's hole"
    assert effect("fixture_compliance").targets(scene) == ["socket"]
    assert effect("peg_grasp_compliance").targets(scene) == ["rod"]
    moved = World(config.robot.model).add(
        EffectInstance.of("hole_offset", "socket", x=0.01),
        EffectInstance.of("hole_tilt", "socket", roll=0.1),
        EffectInstance.of("grip_pose", "rod", y=0.002, pitch=0.05),
    )
    cell = Cell(scene, [World(config.robot.model), moved], 1e-3, 5e-3, 1, [])
    cell.batch.forward()
    goal, turn, tip = cell.site_position("goal"), cell.site_rotation("goal"), cell.site_position("tip")
    np.testing.assert_allclose(goal[1] - goal[0], [0.01, 0.0, 0.0], atol=1e-12)
    angle = np.arccos(0.5 * (np.trace(turn[1] @ turn[0].T) - 1))
    assert angle == pytest.approx(0.1) and 1e-3 < np.linalg.norm(tip[1] - tip[0]) < 0.01


def test_springs_hang_what_the_cell_calls_its_fixture_and_its_part(rod):
    """A push on a spring of compliance c moves the body by c per newton, whatever the body is called."""
    config = config_of({"name": rod})
    scene = task_of(config).cell(config)
    springs = {"fixture_compliance": ("fixture_z", "socket"), "peg_grasp_compliance": ("peg_grasp_x", "rod")}
    model = compiled(scene, springs)
    for joint, body in springs.values():
        assert model.body(model.joint(joint).bodyid[0]).name == body
    soft = EffectInstance.of("fixture_compliance", "socket", z=1e-4)
    cell = Cell(scene, [World(config.robot.model), World(config.robot.model).add(soft)], 1e-3, 5e-3, 1, [soft.effect])
    stiffness = cell.batch.expanded("jnt_stiffness")[:, cell.model.joint("fixture_z").id]
    assert stiffness[1] == pytest.approx(1e4) and stiffness[0] > 1e6


def test_it_is_played_and_rendered(rod, tmp_path):
    import vispeg
    from vispeg.datasets.layout import pose_of
    from vispeg.datasets.read import Dataset

    world = tmp_path / "rod.yaml"
    world.write_text(WORLD)
    played = vispeg.evaluate("expert", world, episodes=3)
    assert all(e.success for e in played.episodes)
    vispeg.render_dataset(tmp_path / "frames", world, frames=4, size=64)
    data = Dataset(tmp_path / "frames")
    assert {"rod", "socket"} <= set(data.parts)
    assert {pose_of("rod", "wrist_wide", data.features), "label.mouth"} <= set(data.features)
    shown = np.unique(data.episode(0)["label.parts.wrist_wide"])
    assert 1 + data.parts.index("rod") in shown and 1 + data.parts.index("socket") in shown
    export(tmp_path / "frames", tmp_path / "bop", "bop")  # what a pose estimator needs of both: masks and a surface
    named = json.loads((tmp_path / "bop/dataset_info.json").read_text())["objects"].values()
    assert sorted((o["name"], o["frame"]) for o in named) == [("rod", "rod"), ("socket", "mouth")]
    assert {p.name for p in (tmp_path / "bop/train/000000/mask_visib").glob("000000_*")} == {
        "000000_000000.png",
        "000000_000001.png",
    }
    assert len(list((tmp_path / "bop/models").glob("*.ply"))) == 2
