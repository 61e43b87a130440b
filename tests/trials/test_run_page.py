"""The files of robots that docs/run.md shows and links are read, and name every key."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from vispeg.formats.typed import typed
from vispeg.trials.lerobot import Wiring, read_wiring
from vispeg.trials.named import driver
from vispeg.trials.ros2 import Topics, read_topics

DOCS = Path(__file__).parents[2] / "docs"
ROBOTS = DOCS / "examples" / "robots"
PAGE = (DOCS / "run.md").read_text(encoding="utf-8")


def first() -> dict[str, object]:
    """The file of topics that the page shows."""
    return yaml.safe_load(re.findall(r"```yaml\n(namespace.*?)```", PAGE, re.DOTALL)[0])


def test_every_key_is_shown():
    assert {*first()} == {*Topics.model_fields}
    assert {*yaml.safe_load((ROBOTS / "so101.yaml").read_text(encoding="utf-8"))} == {*Wiring.model_fields}


@pytest.mark.parametrize(
    ("name", "read"), [("fr3.yaml", read_topics), ("iiwa.yaml", read_topics), ("so101.yaml", read_wiring)]
)
def test_a_linked_file_is_read(name, read):
    assert f"(examples/robots/{name})" in PAGE
    assert read(ROBOTS / name).model_fields_set == {*yaml.safe_load((ROBOTS / name).read_text(encoding="utf-8"))}


def test_the_linked_driver_is_one(monkeypatch):
    assert "(examples/robots/my_driver.py)" in PAGE
    monkeypatch.syspath_prepend(str(ROBOTS))
    robot: Any = driver("python:my_driver:Robot")
    assert robot.connect(None, 0).wrench.tared == "weight" and robot.read().q.shape == (7,)


def test_the_names_of_the_first_file_are_the_defaults():
    told, default = typed(Topics, first(), "docs/run.md"), Topics()
    for key in ("joint_states", "target_pose", "current_pose", "base_frame", "end_effector", "wrench"):
        assert getattr(told, key) == getattr(default, key), key
    assert told.camera("wrist_wide") == default.camera("wrist_wide")
