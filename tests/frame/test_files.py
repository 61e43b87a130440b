"""Results appear whole or not at all, and never on top of what is not theirs."""

import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from vispeg.core.errors import UserError
from vispeg.core.files import (
    new_folder,
    remove_abandoned,
    reserved,
    set_aside,
    write_bytes_atomic,
    write_files_atomic,
    write_text_atomic,
)
from vispeg.core.marker import MARKER


def test_folder_takes_its_name_only_when_complete(tmp_path):
    target = tmp_path / "a" / "b" / "out"
    with new_folder(target) as folder:
        (folder / "x.txt").write_text("1")
        assert folder.parent == target.parent, "a rename is atomic only within one file system"
        assert not target.exists()
    assert [p.name for p in target.parent.iterdir()] == ["out"]
    assert (target / "x.txt").read_text() == "1"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, UserError])
def test_failure_leaves_what_stood_there_and_nothing_else(tmp_path, error):
    target = tmp_path / "out"
    with new_folder(target) as folder:
        (folder / "old.txt").write_text("old")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(error), new_folder(target, overwrite=True) as folder:
        (folder / "new.txt").write_text("new")
        raise error("x")
    assert sorted(tmp_path.rglob("*")) == before and (target / "old.txt").read_text() == "old"


def test_existing_content_is_kept_unless_overwrite(tmp_path):
    target = tmp_path / "out"
    target.mkdir()
    with new_folder(target) as folder:  # empty: as good as none
        (folder / "one").touch()
    with pytest.raises(UserError, match="not empty.*overwrite"), new_folder(target):
        pass
    with new_folder(target, overwrite=True) as folder:
        (folder / "two").touch()
    assert {p.name for p in target.iterdir()} == {"two", MARKER}, (
        "replaced as a whole: no stale result beside a new one"
    )
    assert list(tmp_path.iterdir()) == [target]


def test_content_that_appears_while_writing_is_kept(tmp_path):
    target = tmp_path / "out"
    with pytest.raises(UserError, match="not empty"), new_folder(target) as folder:
        (folder / "mine").touch()
        target.mkdir()
        (target / "theirs").touch()
    assert [p.name for p in target.iterdir()] == ["theirs"]


def test_overwrite_never_takes_home_work_or_a_checkout(tmp_path, monkeypatch):
    work, home, code = tmp_path / "work", tmp_path / "home" / "me", tmp_path / "code"
    for folder in (work / "deep", home, code / ".git"):
        folder.mkdir(parents=True)
    (home / "thesis.tex").touch()
    monkeypatch.chdir(work / "deep")
    (work / "deep" / "x").touch()
    monkeypatch.setenv("HOME", str(home))
    before = sorted(tmp_path.rglob("*"))
    for path in (".", "..", work, home, home.parent, "~", code, "/"):
        with pytest.raises(UserError, match="not replaced"), new_folder(path, overwrite=True):
            pass
    assert sorted(tmp_path.rglob("*")) == before


def test_a_link_keeps_pointing(tmp_path):
    (tmp_path / "disk").mkdir()
    link = tmp_path / "out"
    link.symlink_to(tmp_path / "disk")
    with new_folder(link) as folder:
        (folder / "x").touch()
    assert link.is_symlink() and (tmp_path / "disk" / "x").exists()


def test_a_file_in_the_way_is_said_in_one_line(tmp_path):
    (tmp_path / "f").write_text("x")
    for path in (tmp_path / "f", tmp_path / "f" / "below"):
        with pytest.raises(UserError) as caught, new_folder(path, overwrite=True):
            pass
        assert "\n" not in str(caught.value) and str(path) in str(caught.value)
    with pytest.raises(UserError, match="a folder above it is a file"):
        write_text_atomic(tmp_path / "f" / "below", "y")
    assert (tmp_path / "f").read_text() == "x"


def test_permissions_follow_the_users_umask(tmp_path):
    old = os.umask(0o027)
    try:
        with new_folder(tmp_path / "out"):
            pass
        write_text_atomic(tmp_path / "t", "")
    finally:
        os.umask(old)
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o750
    assert stat.S_IMODE((tmp_path / "t").stat().st_mode) == 0o640


def test_text_and_bytes(tmp_path):
    path = tmp_path / "sub" / "model.yaml"
    assert write_text_atomic(path, "ä\n") == path and path.read_bytes() == "ä\n".encode()
    with pytest.raises(UserError, match="overwrite"):
        write_text_atomic(path, "b")
    write_bytes_atomic(path, b"\x00", overwrite=True)
    assert path.read_bytes() == b"\x00"
    with pytest.raises(UserError, match="is a folder"):
        write_text_atomic(tmp_path, "c", overwrite=True)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["model.yaml", "sub"]


def test_failing_write_leaves_no_part(tmp_path, monkeypatch):
    path = tmp_path / "f"
    path.write_text("old")
    monkeypatch.setattr(Path, "write_bytes", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(UserError, match="No space left"):
        write_text_atomic(path, "new", overwrite=True)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_of_several_files_all_are_written_or_none(tmp_path, monkeypatch):
    """The last rename fails, as in a folder that has just been remounted read-only."""
    first, second, third = tmp_path / "new" / "mesh", tmp_path / "texture", tmp_path / "model.xml"
    second.write_bytes(b"old")
    third.write_bytes(b"old")
    files, rename = {first: b"1", second: b"2", third: b"3"}, os.replace

    def failing(source, target):
        if Path(target) == third:
            raise OSError(30, "Read-only file system")
        rename(source, target)

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(UserError, match=r"model.xml: cannot be written: Read-only"):
        write_files_atomic(files, overwrite=True)
    assert {p: p.read_bytes() for p in tmp_path.iterdir()} == {second: b"old", third: b"old"}
    monkeypatch.undo()
    write_files_atomic(files, overwrite=True)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == files


def test_several_files_are_found_below_the_home_directory(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "mine.xml").write_text("mine")
    (tmp_path / "meshes").mkdir()
    for name, said in (("mine.xml", "exists already"), ("meshes", "is a folder")):
        with pytest.raises(UserError, match=f"{name}: {said}"):
            write_files_atomic({Path("~") / name: b"new"}, overwrite=False)
    assert (tmp_path / "mine.xml").read_text() == "mine"


WRITER = """
import signal, sys, time
from vispeg.core.files import new_folder
signal.signal(signal.SIGINT, signal.default_int_handler)  # whoever began the tests in the background ignores it
with new_folder(sys.argv[1]) as folder:
    (folder / "half").write_text("written")
    print("ready", flush=True)
    time.sleep(60)
"""


def writer(target):
    """A process that stands in the middle of writing `target`."""
    command = [sys.executable, "-c", WRITER, str(target)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, cwd=Path(__file__).parents[2], text=True)
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    return process


@pytest.mark.parametrize(("number", "left"), [(signal.SIGTERM, 0), (signal.SIGINT, 0), (signal.SIGKILL, 2)])
def test_a_run_that_is_ended_leaves_nothing_and_the_next_one_clears_up(tmp_path, number, left):
    with writer(tmp_path / "out") as process:
        process.send_signal(number)
        assert process.wait(10) != 0
    assert len(list(tmp_path.iterdir())) == left
    with new_folder(tmp_path / "out"):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_what_is_not_ours_or_still_being_written_stays(tmp_path):
    others = (".out.part", ".out.mine.part", ".out.0123456g.part", ".other.01234567.part", "out.01234567.part")
    for name in others:
        (tmp_path / name).mkdir()
    with writer(tmp_path / "out") as process:
        half = next(tmp_path.glob(".out.*/half")).parent
        remove_abandoned(tmp_path / "out")
        assert {p.name for p in tmp_path.iterdir()} == {*others, half.name, ".out.lock"}
        process.kill()


def test_the_second_writer_is_told_who_the_first_is(tmp_path):
    with writer(tmp_path / "out") as process:
        said = rf"process {process.pid} writes it since \d{{4}}-\d\d-\d\d .*{re.escape(str(tmp_path))}.*another folder"
        before = sorted(tmp_path.rglob("*"))
        for path in (tmp_path / "out", tmp_path / "x" / ".." / "out"):
            with pytest.raises(UserError, match=said), new_folder(path, overwrite=True):
                pass
        assert sorted(tmp_path.rglob("*")) == before
        process.kill()
    with new_folder(tmp_path / "out"):  # a lock ends with its process
        pass


def test_overwrite_takes_only_what_this_program_wrote_and_of_its_kind(tmp_path):
    target = tmp_path / "out"
    (target / "deep").mkdir(parents=True)
    (target / "deep" / "mine.csv").write_text("years of work")

    def refused(said, holds="comparison"):
        before = {p: p.read_bytes() for p in target.rglob("*") if p.is_file()}
        with pytest.raises(UserError, match=said), new_folder(target, overwrite=True, holds=holds):
            pass
        assert {p: p.read_bytes() for p in target.rglob("*") if p.is_file()} == before

    refused("has no .vispeg.json .*move it away or name another folder")
    shutil.rmtree(target)
    with new_folder(target, holds="recording") as folder:
        (folder / "deep").mkdir()
        (folder / "deep" / "samples.csv").touch()
    refused("holds another kind of result .recording, not comparison.*move it away")
    (target / "deep" / "notes.txt").touch()
    refused("holds deep/notes.txt, which this program did not write", "recording")
    (target / "deep" / "notes.txt").unlink()
    (target / MARKER).write_text("{}")
    refused("has no .vispeg.json", "recording")


def test_an_output_is_no_input_and_not_above_one(tmp_path, monkeypatch):
    (tmp_path / "data" / "rig").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "data" / "rig")
    (tmp_path / "data" / "away").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "data")
    for out, given, said in (
        ("rig", "rig/.", "is read by this command"),
        ("../data/rig", tmp_path / "link", "is read"),
        ("../link", "./rig", "is read"),
        ("../data", Path("rig"), "holds rig, which this command reads"),
        (tmp_path, Path("rig"), "holds rig"),
        (tmp_path / "data", Path("away"), "holds away"),
        (tmp_path / "elsewhere", Path("away"), "is read"),
    ):
        with pytest.raises(UserError, match=said), new_folder(out, overwrite=True, inputs=[None, given]):
            pass
    with new_folder("rig/checked", inputs=[Path("rig"), "iiwa14", Path("nowhere")]):
        pass
    (tmp_path / "data" / "iiwa14").mkdir()
    with new_folder("iiwa14", inputs=["iiwa14"]):  # a name of something built in
        pass


def test_killed_in_the_act_of_replacing_the_old_result_comes_back(tmp_path):
    target = tmp_path / "out"
    with new_folder(target) as folder:
        (folder / "x").write_text("old")
    os.replace(target, tmp_path / ".out.01234567.old")
    with pytest.raises(UserError, match="overwrite"), new_folder(target):
        pass
    assert (target / "x").read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["out"]
    (tmp_path / ".out.76543210.old").mkdir()  # killed before it had cleared up
    with new_folder(target, overwrite=True):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


ASIDE = """
import sys, time
from pathlib import Path
from vispeg.core.files import set_aside
from vispeg.core.lock import claimed
with claimed(sys.argv[1]), set_aside(sys.argv[1], lambda: False):
    if sys.argv[2:]:
        Path(sys.argv[1]).mkdir()
    print("ready", flush=True)
    sys.stdin.read()
    raise KeyboardInterrupt
"""


@pytest.mark.parametrize("begun", [[], ["begun"]])
def test_what_another_process_put_aside_is_left_to_it(tmp_path, begun):
    """A command on a folder that a run is replacing is refused; the run fails, and its old folder is back."""
    target = tmp_path / "out"
    with new_folder(target) as folder:
        (folder / "x").write_text("old")
    command = [sys.executable, "-c", ASIDE, str(target), *begun]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    with subprocess.Popen(command, cwd=Path(__file__).parents[2], **pipes) as process:
        assert process.stdout.readline() == "ready\n"
        before = sorted(tmp_path.rglob("*"))
        with pytest.raises(UserError, match="writes it since"), reserved(target, True, holds="result"):
            pass
        assert sorted(tmp_path.rglob("*")) == before
        process.stdin.close()
    assert (target / "x").read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["out"]


REMOVING = """
import os, signal, sys
from pathlib import Path
from vispeg.core.files import new_folder

def killed(*_):
    os.kill(os.getpid(), signal.SIGKILL)

with new_folder(sys.argv[1], overwrite=True) as folder:
    (folder / "x").write_text("new")
    os.unlink = killed
"""


def test_a_folder_whose_removal_was_killed_half_way_does_not_come_back(tmp_path):
    """Not even if what replaced it is removed by hand."""
    target = tmp_path / "out"
    with new_folder(target) as folder:
        (folder / "x").write_text("old")
    done = subprocess.run([sys.executable, "-c", REMOVING, str(target)], cwd=Path(__file__).parents[2])
    assert done.returncode == -signal.SIGKILL and (target / "x").read_text() == "new"
    shutil.rmtree(target)
    with new_folder(target) as folder:
        (folder / "x").write_text("newer")
    assert (target / "x").read_text() == "newer" and [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("fault", ["kept", "rename"])
def test_a_folder_put_aside_is_not_removed_unless_it_is_replaced(tmp_path, monkeypatch, fault):
    """Neither where it is not known whether the new one is worth keeping, nor where it cannot be put back."""
    target, rename = tmp_path / "out", os.replace
    target.mkdir()
    (target / "x").write_text("old")

    def kept():
        if fault == "kept":
            raise PermissionError(13, "Permission denied")
        return False

    def failing(source, to):
        if Path(to) == target:
            raise OSError(5, "Input/output error")
        rename(source, to)

    with pytest.raises((OSError, UserError)) as raised, set_aside(target, kept):
        target.mkdir()
        if fault == "rename":
            monkeypatch.setattr(os, "replace", failing)
        raise ValueError
    (old,) = tmp_path.glob(".out.*.old")
    assert (old / "x").read_text() == "old"
    assert fault == "kept" or str(old) in str(raised.value)


def test_a_disk_that_is_full_is_said_in_one_line(tmp_path):
    target = tmp_path / "out"
    with pytest.raises(UserError, match="out: cannot be written: No space left"), new_folder(target) as folder:
        (folder / "half").write_text("x")
        raise OSError(28, "No space left on device")
    assert not list(tmp_path.iterdir())
    with pytest.raises(FileNotFoundError), new_folder(target):  # reading something else is another matter
        (tmp_path / "input.csv").read_text()


def test_the_way_termination_was_handled_comes_back(tmp_path):
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as stop, new_folder(tmp_path / "out"):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(1)
    assert stop.value.code == 143 and signal.getsignal(signal.SIGTERM) == before and not list(tmp_path.iterdir())
