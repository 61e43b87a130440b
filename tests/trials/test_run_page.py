"""The files of a robot's names that docs/run.md shows are read, and name every key."""

import re
from pathlib import Path

import pytest
import yaml

from vispeg.formats.typed import typed
from vispeg.trials.lerobot import Wiring
from vispeg.trials.ros2 import Topics

PAGE = (Path(__file__).parents[2] / "docs" / "run.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("heading", "kind", "files"), [("over ROS 2", Topics, 3), ("over LeRobot", Wiring, 1)])
def test_a_shown_file_is_read_and_every_key_is_shown(heading, kind, files):
    section = PAGE.split(f"## An arm {heading}\n")[1].split("\n## ")[0]
    shown = [yaml.safe_load(block) for block in re.findall(r"```yaml\n(.*?)```", section, re.DOTALL)]
    assert len(shown) == files
    for data in shown:
        typed(kind, data, "docs/run.md")
    assert {key for data in shown for key in data} == {*kind.model_fields}


def test_the_names_of_the_first_file_are_the_defaults():
    first = yaml.safe_load(re.findall(r"```yaml\n(namespace.*?)```", PAGE, re.DOTALL)[0])
    told, default = typed(Topics, first, "docs/run.md"), Topics()
    for key in ("joint_states", "target_pose", "current_pose", "base_frame", "end_effector", "wrench"):
        assert getattr(told, key) == getattr(default, key), key
    assert told.camera("wrist_wide") == default.camera("wrist_wide")
