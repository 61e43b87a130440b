"""What is offered is what is there, by its content."""

import os
import shutil

import pytest

from vispeg.core.assets import assets
from vispeg.view.around import MOST, around, kind_of, named, shipped_recordings
from vispeg.view.opened import opened


@pytest.fixture
def place(tmp_path):
    """One of each kind, as users have them, beside what is none."""
    shutil.copytree(assets() / "recordings" / "rig-a", tmp_path / "today" / "rig-a")
    (tmp_path / "arm.urdf").write_text('<?xml version="1.0"?>\n<robot name="a"><link name="b"/></robot>')
    (tmp_path / "notes.xml").write_text("<html/>")
    (tmp_path / "model.yaml").write_text("format: vispeg-model/1\nrobot: iiwa14\n")
    (tmp_path / "mine.yaml").write_text("format: vispeg-world/1\nname: mine\nbase: [nominal]\n")
    (tmp_path / "log.csv").write_text("t,q1\n0,0\n")
    (tmp_path / "runs" / "one" / "checkpoints" / "best").mkdir(parents=True)
    (tmp_path / "runs" / "one" / "begun.json").write_text("{}")
    (tmp_path / "runs" / "one" / "checkpoints" / "best" / "policy.json").write_text("{}")
    (tmp_path / "frames" / "meta").mkdir(parents=True)
    (tmp_path / "frames" / "meta" / "info.json").write_text("{}")
    (tmp_path / "trials" / "trial-0001").mkdir(parents=True)
    for name in ("trial.yaml", "recording.yaml"):
        (tmp_path / "trials" / "trial-0001" / name).write_text("format: ?")
    (tmp_path / ".hidden").mkdir()
    (tmp_path / ".hidden" / "log.csv").write_text("t,q1\n0,0\n")
    os.mkfifo(tmp_path / "pipe.csv")
    os.mkfifo(tmp_path / "pipe.urdf")
    (tmp_path / "round").symlink_to(tmp_path)
    return tmp_path


def test_each_kind_is_found_and_nothing_else(place):
    found = {kind: list(named(paths, place)) for kind, paths in around(place).places.items()}
    assert found == {
        "recording": ["today/rig-a", "trials/trial-0001"],
        "trials": ["trials"],
        "model": ["arm.urdf", "model.yaml"],
        "world": ["mine.yaml"],
        "log": ["log.csv"],
        "run": ["runs/one"],
        "policy": ["runs/one/checkpoints/best"],
        "dataset": ["frames"],
    }


def test_what_is_offered_is_opened_as_what_it_is(place):
    pages = {"recording": "Diagnose", "log": "Import", "world": "Worlds", "run": "Training", "dataset": "Data"}
    pages |= {"policy": "Policies", "trials": "Trials"}
    for kind, paths in around(place).places.items():
        for path in paths:
            assert opened([str(path)]).page == pages.get(kind, "Diagnose"), path
            assert kind != "model" or opened([str(path)]).model == str(path)


def test_a_large_folder_ends_the_look(tmp_path):
    for i in range(MOST + 10):
        (tmp_path / f"{i}.txt").touch()
    assert around(tmp_path).more


def test_the_shipped_recordings_are_recordings():
    assert [kind_of(p) for p in shipped_recordings()] == ["recording"] * 3
