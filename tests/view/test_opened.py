"""What the command is given is told apart by its content."""

from pathlib import Path

import pytest

from vispeg.core.errors import UserError
from vispeg.view.opened import opened


def test_recordings_folders_of_them_models_and_logs(rigs, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("t\n0\n")
    found = opened([str(rigs), str(rigs / "rig-a"), str(rigs / "arm.xml"), str(log)])
    assert found.recordings == tuple(rigs / name for name in ("rig-a", "rig-b", "rig-c"))
    assert found.model == str(rigs / "arm.xml") and found.logs == (log,)


@pytest.mark.parametrize(("name", "said"), [("none", "is not there"), ("x.txt", "cannot be shown")])
def test_what_cannot_be_shown_is_said(tmp_path, name, said):
    if name == "x.txt":
        (tmp_path / name).write_text("?")
    with pytest.raises(UserError, match=said):
        opened([str(tmp_path / name)])


def test_names_of_what_comes_with_the_package(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = opened(["iiwa14", "searching", "depth-S"])
    assert (found.model, found.world, found.policy, found.page) == ("iiwa14", "searching", "depth-S", "Policies")
    assert opened(["searching"]).page == "Worlds"


def test_without_anything_the_page_still_opens():
    assert opened([]).recordings == () and Path(opened([]).model).name == "iiwa14"
