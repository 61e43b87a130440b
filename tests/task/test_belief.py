"""The cell that a user believes in: a world's, a recording's, or the default one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vispeg.api.inputs import read_inputs, read_model
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.recordings.cell import OPEN_CELL, CellBelief
from vispeg.recordings.recording import Control, Recording
from vispeg.robots.declared import declared
from vispeg.robots.model import load as load_robot
from vispeg.task.belief import believed, cell_of
from vispeg.task.peg.config import PegConfig
from vispeg.worlds.model_file import load_model, model_text
from vispeg.worlds.places import ALL
from vispeg.worlds.world import World

WORLD = """format: vispeg-world/1
name: rig
task: {clearance_mm: 2.0, fixture: [0.55, 0.1, 0.05]}
effects:
  - {effect: hole_tilt, where: fixture, params: {roll: 0.02}}
  - {effect: contact_friction, where: peg, params: {scale: {uniform: [0.5, 2.0]}}}
"""


def test_the_default_belief_is_the_task_s_own_cell():
    for cell in (None, CellBelief(), CellBelief(OPEN_CELL), CellBelief("nominal")):
        found = believed(cell)
        assert found.scene.config == PegConfig().scene() and found.world == World("iiwa14")
    assert believed(None).scene is believed(CellBelief("nominal")).scene


def test_what_a_world_fixes_is_believed_and_what_it_draws_is_not(tmp_path):
    (tmp_path / "rig.yaml").write_text(WORLD)
    cell = CellBelief(str(tmp_path / "rig.yaml"), {"clearance_mm": 1.0}, None, ())
    found = believed(cell)
    assert (found.config.clearance_mm, found.scene.target) == (1.0, (0.55, 0.1, 0.05))
    assert [e.label for e in found.world.effects] == ["hole_tilt(fixture)"]
    assert found.world.effects[0].params["roll"].value == 0.02


@pytest.mark.parametrize("name", ["P", "dev", "VNP"])
def test_what_a_world_fixes_at_each_place_is_believed_at_every_one(name):
    found = believed(CellBelief(name))
    assert all(e.where in (ALL, *effect(e.effect).targets(found.scene)) for e in found.world.effects)
    damped = [e.where for e in found.world.effects if e.effect == "viscous_friction"]
    assert damped == [*effect("viscous_friction").targets(found.scene)]


def test_a_belief_s_effects_are_placed_in_its_cell():
    grip = {"effect": "grip_pose", "where": "peg", "params": {"x": 0.0005}}
    found = believed(CellBelief(effects=(grip,)))
    assert found.world.effects == (EffectInstance.of("grip_pose", "peg", x=0.0005),)


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        (CellBelief("nowhere"), "unknown world"),
        (CellBelief(task={"clearence_mm": 1.0}), "clearence_mm"),
        (CellBelief(task={"clearance_mm": -1.0}), "clearance_mm"),
        (CellBelief(effects=({"effect": "grip_pos", "where": "peg"},)), "grip_pos"),
        (CellBelief(effects=({"effect": "grip_pose", "where": "joint1"},)), "joint1"),
        (CellBelief(robot={"tools": "meg50"}), "tools"),
    ],
)
def test_a_belief_that_cannot_be_names_its_file(cell, message):
    with pytest.raises(UserError, match=message) as caught:
        believed(cell, "rig-a/recording.yaml")
    assert "rig-a/recording.yaml" in str(caught.value) and "\n" not in str(caught.value)


def test_peg_cell_is_the_cell_that_each_recording_states(tmp_path):
    world, stated = read_model(OPEN_CELL), CellBelief(task={"clearance_mm": 1.0})
    control = Control()
    rec = Recording(Path("r"), "iiwa14", ("joint1",), 500.0, control, np.zeros(2), np.zeros((2, 1)), cell=stated)
    assert cell_of(world, rec) == stated
    assert believed(cell_of(world, replace(rec, cell=None))).config == PegConfig()
    assert cell_of(read_model("iiwa14"), rec) is None
    named = read_model("nominal")
    assert cell_of(named, rec) == CellBelief("nominal")
    assert declared("iiwa14", world.tool) == {**dict(named.tool), "name": world.tool}


def test_a_model_file_of_a_cell_comes_back(tmp_path):
    world = load_model(OPEN_CELL).add(EffectInstance.of("contact_friction", "peg", scale=1.7))
    (tmp_path / "model.yaml").write_text(model_text(world))
    assert read_model(str(tmp_path / "model.yaml")) == world
    text = (tmp_path / "model.yaml").read_text()
    (tmp_path / "model.yaml").write_text(text.replace("where: peg", "where: joint3"))
    with pytest.raises(UserError, match="joint3"):
        read_model(str(tmp_path / "model.yaml"))
    (tmp_path / "model.yaml").write_text(text.replace("cell: peg-cell\n", ""))
    with pytest.raises(UserError, match="effects"):
        read_model(str(tmp_path / "model.yaml"))


@pytest.mark.parametrize("model", ["nominal", "peg-cell"])
def test_joints_are_read_in_the_robot_s_order_in_every_cell(model):
    names = load_robot("iiwa14").joints
    time = np.arange(200) / 100
    q = 0.1 * np.arange(1, 8) * np.sin(3 * time)[:, None]
    rec = Recording(Path("r"), "iiwa14", names[::-1], 100.0, Control("gravity_comp", 100.0, "model"), time, q[:, ::-1])
    (found,) = read_inputs(model, rec, (), need_validate=False, seconds=0.0).fitted
    assert found.joints == names and np.array_equal(found.q, q)
