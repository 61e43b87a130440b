"""A gripper from an MJCF made here: what it weighs, where it holds, and the task with it."""

from pathlib import Path

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.robots import tools
from vispeg.robots.model import load
from vispeg.robots.scene import build
from vispeg.task.peg.task import PegInHoleVec
from vispeg.task.world_file import load_world
from vispeg.worlds.model_file import load_model, write_model
from vispeg.worlds.world import World

GRIPPER = """<mujoco>
  <asset><mesh name="palm" vertex="-.03 -.03 0  .03 -.03 0  .03 .03 0  -.03 .03 0  0 0 .06"/></asset>
  <worldbody>
    <body name="hand">
      <inertial pos="0 0 .03" mass=".5" diaginertia="4e-4 5e-4 3e-4"/>
      <geom type="mesh" mesh="palm"/>
      <body name="left" pos=".014 0 .075">
        <joint name="slide" type="slide" axis="1 0 0" range="0 .02"/>
        <geom type="box" size=".006 .01 .02" mass=".03"/>
      </body>
      <body name="right" pos="-.014 0 .075"><geom type="box" size=".006 .01 .02" mass=".03"/></body>
      <site name="grasp" pos="0 0 {grasp}"/>
    </body>
  </worldbody>
  <actuator><position joint="slide"/></actuator>
</mujoco>"""


@pytest.fixture
def world(tmp_path):
    (tmp_path / "hand.xml").write_text(GRIPPER.format(grasp=0.07))
    file = tmp_path / "w" / "mine.yaml"
    file.parent.mkdir()
    file.write_text("format: vispeg-world/1\nname: mine\nbase: nominal\nrobot: {tool: ../hand.xml}\n")
    return file


def test_its_mass_and_place_are_the_files(tmp_path, world):
    """Parallel axes by hand; the peg hangs at the site, whatever the fingers weigh."""
    arm = load("iiwa14", f"{tmp_path / 'hand.xml'}+peg16").compile()
    tool, peg = arm.body("tool"), arm.body("peg")
    assert tool.mass[0] == pytest.approx(0.56) and tool.ipos[2] == pytest.approx((0.5 * 0.03 + 0.06 * 0.075) / 0.56)
    across = 4e-4 + 0.5 * (0.03 - tool.ipos[2]) ** 2
    across += 2 * (0.03 * (0.01**2 + 0.02**2) / 3 + 0.03 * (0.075 - tool.ipos[2]) ** 2)
    assert np.sort(tool.inertia)[1:] == pytest.approx(
        np.sort([across, across + 1e-4 + 2 * 0.03 * ((0.006**2 - 0.01**2) / 3 + 0.014**2)]), rel=1e-6
    )
    assert peg.ipos[2] == pytest.approx(0.07 + tools.PEG_LENGTH / 2) and arm.njnt == 7
    scene = build(PegInHoleVec(1, world=world).config.scene())
    assert scene.tip == pytest.approx(0.07 + tools.PEG_LENGTH)
    assert len(scene.parts["gripper"]) == 3


def test_the_task_is_done_with_it(world):
    """The expert inserts; the fingers stay clear of the block."""
    from vispeg import evaluate

    result = evaluate("expert", world, episodes=3)
    assert [e.success for e in result.episodes] == [True] * 3


def test_what_is_in_the_file_makes_the_world(tmp_path, world, monkeypatch):
    first = load_world(world).hash
    monkeypatch.chdir(world.parent)
    assert load_world("mine.yaml").hash == first
    (tmp_path / "hand.xml").write_text(GRIPPER.format(grasp=0.071))
    assert load_world("mine.yaml").hash != first


@pytest.mark.parametrize("held", ["", "+peg16"])
def test_a_model_with_it_is_the_same_in_any_folder(tmp_path, monkeypatch, held):
    (tmp_path / "hand.xml").write_text(GRIPPER.format(grasp=0.07))
    monkeypatch.chdir(tmp_path)
    file = write_model(Path("deep/er/model.yaml"), World("iiwa14", f"hand.xml{held}"))
    monkeypatch.chdir(tmp_path / "deep")
    again = load_model(Path("er") / file.name)
    mass = load("iiwa14", f"{tmp_path / 'hand.xml'}{held}").compile().body_mass.sum()
    assert load(again.robot, again.tool).compile().body_mass.sum() == mass


def test_what_cannot_hold_is_refused(tmp_path, world):
    """With the file and what is expected."""
    for text, said in (
        (GRIPPER.replace('name="grasp"', 'name="tcp"'), "a site 'grasp'.*got.*tcp"),
        (GRIPPER.replace('name="grasp" pos="0 ', 'name="grasp" pos=".01 '), "off the flange's axis"),
        (GRIPPER.replace("{grasp}", "0.03"), "touch the block"),
        ("<mujoco", "not XML"),
    ):
        (tmp_path / "hand.xml").write_text(text.format(grasp=0.07))
        with pytest.raises(UserError, match=said) as refused:
            load_world(world)
        assert "hand.xml" in str(refused.value)
    (tmp_path / "hand.xml").unlink()
    with pytest.raises(UserError, match="no such gripper"):
        load_world(world)
