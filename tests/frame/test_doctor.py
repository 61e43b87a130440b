"""`vispeg doctor` tells what is missing and how to get it, and fails only for what the base needs."""

import json
import os
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from vispeg.api.machine import doctor, graphics, installed
from vispeg.api.machine.doctor import Finding, Machine
from vispeg.cli.doctor import doctor as command
from vispeg.core.broken import in_words, run


@pytest.mark.slow
def test_json_says_what_the_exit_code_says(capsys):
    code = command(["--json"])
    record = json.loads(capsys.readouterr().out)
    assert record["format"] == "vispeg-doctor/1"
    needed = [f for f in record["findings"] if f["needed"]]
    assert {f["name"] for f in needed} == {"python", "packages", "physics"}
    assert record["ok"] == all(f["ok"] for f in needed) == (code == 0)
    assert code == 0, needed
    assert all(f["fix"] for f in record["findings"] if not f["ok"])


def test_wrong_version_of_a_needed_package_fails_and_names_both(monkeypatch):
    true = metadata.version
    monkeypatch.setattr(installed.metadata, "version", lambda name: "3.1.0" if name == "mujoco" else true(name))
    base = next(f for f in doctor._packages() if f.name == "packages")
    assert base.needed and not base.ok
    assert "mujoco 3.1.0, needed" in base.detail and "4.0" in base.detail


def test_missing_extra_is_not_a_failure(monkeypatch):
    def version(name):
        if name == "rosbags":
            raise metadata.PackageNotFoundError(name)
        return "4.0.1" if name == "mujoco" else "999"

    monkeypatch.setattr(installed.metadata, "version", version)
    logs = next(f for f in doctor._packages() if f.name == "extra 'logs'")
    assert not logs.ok and not logs.needed and "rosbags is not installed" in logs.detail and "logs" in logs.fix


def test_a_package_without_its_metadata_is_to_be_installed_again(monkeypatch):
    """The folder of its metadata is there, and empty: pip takes it for installed."""

    def version(name):
        if name == "rosbags":
            raise TypeError("expected string or bytes-like object")
        return "4.0.1" if name == "mujoco" else "999"

    monkeypatch.setattr(installed.metadata, "version", version)
    logs = next(f for f in doctor._packages() if f.name == "extra 'logs'")
    assert "rosbags is half installed" in logs.detail and "--force-reinstall" in logs.fix


def test_table_marks():
    optional = Finding("gpu", False, "none", fix="buy one")
    machine = Machine([Finding("python", True, "3", True), optional])
    assert machine.healthy and "Ready." in str(machine)
    assert "-> buy one" in str(machine) and "FAIL" not in str(machine)
    machine = Machine([Finding("physics", False, "no", True, "install it"), optional])
    assert not machine.healthy and "FAIL  physics" in str(machine) and "Not ready" in str(machine)


def test_a_backend_that_cannot_draw_is_a_finding_not_a_crash():
    result = graphics.probe("no-such-backend")
    assert not result.ok and result.detail
    assert "no answer" in graphics.probe("egl", timeout=0.001).detail


def test_backend_is_chosen_only_where_the_user_has_not(monkeypatch):
    monkeypatch.setattr(graphics, "has_library", lambda name: True)
    monkeypatch.setattr(graphics.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    graphics.choose_backend()
    assert graphics.os.environ["MUJOCO_GL"] == "osmesa"
    monkeypatch.delenv("MUJOCO_GL")
    monkeypatch.setattr(graphics, "has_library", lambda name: name != "libEGL.so.1")
    graphics.choose_backend()
    assert "MUJOCO_GL" not in graphics.os.environ, "`import mujoco` would fail"
    monkeypatch.setattr(graphics, "has_library", lambda name: True)
    graphics.choose_backend()
    assert graphics.os.environ["MUJOCO_GL"] == "egl"


PYTHONS = re.compile(r"Traceback|\w+Error\b|\w*Exception\b|File \"|<module")
BROKEN = {  # what stands in the way of the true packages -> what the doctor says of it
    "tyro.py": ("import no_such_parser", "tyro: no_such_parser is not installed"),
    "scipy.py": ("raise ModuleNotFoundError(\"No module named 'scipy'\")", "scipy: scipy is not installed"),
    "cma.py": ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "cma: it crashes (Segmentation fault)"),
    "yaml.py": ("x = 1\0", "PyYAML: one of its files is damaged"),
    "pyarrow.py": ("class Odd(BaseException): pass\nraise Odd('x' * 999)", "pyarrow: xxx"),
    "mujoco/__init__.py": ("", "mujoco is half installed: no MjModel"),
    "torch.py": (
        "raise ImportError('libcudart.so.12: cannot open shared object file: No such file')",
        "the library libcudart.so.12 is missing",
    ),
}


def test_whatever_is_broken_is_said_in_words_even_without_the_parser_of_arguments(tmp_path):
    for name, (text, _) in BROKEN.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    path = os.pathsep.join((str(tmp_path), str(Path(__file__).parents[2])))
    command = [sys.executable, "-m", "vispeg", "doctor"]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, timeout=250)
    assert done.returncode == 1 and done.stderr == "", done.stdout + done.stderr
    assert all(said in done.stdout for _, said in BROKEN.values()), done.stdout
    assert "Not ready" in done.stdout and not PYTHONS.search(done.stdout), done.stdout


def test_a_reader_of_versions_that_is_not_there_is_a_finding_too(monkeypatch):
    monkeypatch.setitem(sys.modules, "packaging.requirements", None)
    (found,) = doctor._look("packages", doctor._packages)
    assert found.needed and not found.ok and found.fix and not PYTHONS.search(found.detail), found.detail


def test_a_driver_that_is_missing_and_a_wrong_choice_of_one_are_said_in_words(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "bogus")
    found = doctor._physics()
    assert found.needed and not found.ok and "MUJOCO_GL=bogus" in found.detail and found.fix == "unset MUJOCO_GL"
    assert not PYTHONS.search(found.detail)
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nowhere.json")  # glvnd then knows no driver
    probe = graphics.probe("egl")
    assert not probe.ok and probe.detail and not PYTHONS.search(probe.detail), probe.detail


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "Traceback (most recent call last):\n  x\nModuleNotFoundError: No module named 'torch'\n",
            "torch is not installed",
        ),
        ("ModuleNotFoundError: No module named 'scipy.optimize'", "scipy is half installed: its optimize is missing"),
        ("ImportError: /x/libEGL.so.1: file too short", "the library libEGL.so.1 is damaged"),
        ("AttributeError: 'NoneType' object has no attribute 'eglQueryString'", "its library is missing"),
        (
            "OpenGL.raw.EGL._errors.EGLError: EGLError(\n\terr = EGL_NOT_INITIALIZED,\n\tresult = 0\n)",
            "the driver says EGL_NOT_INITIALIZED",
        ),
        ("KeyboardInterrupt", "it ended without a message"),
        ("the picture is blank\n", "the picture is blank"),
        ("", ""),
    ],
)
def test_a_traceback_is_put_into_words(text, words):
    assert in_words(text) == words


def test_a_program_that_hangs_or_is_not_there_is_a_finding():
    assert run([sys.executable, "-c", "import time; time.sleep(9)"], timeout=0.2) == (False, "no answer in 0 s")
    assert run(["/no/such/program"]) == (False, "No such file or directory")
    assert run([sys.executable, "-c", "print(1); print(2)"]) == (True, "2")
