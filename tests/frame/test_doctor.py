"""`vispeg doctor` tells what is missing and how to get it, and fails only for what the base needs."""

import json
from importlib import metadata

from vispeg.cli import doctor, graphics
from vispeg.cli.doctor import Args, Finding


def test_json_says_what_the_exit_code_says(capsys):
    code = Args(json=True).run()
    record = json.loads(capsys.readouterr().out)
    assert record["format"] == "vispeg-doctor/1"
    needed = [f for f in record["findings"] if f["needed"]]
    assert {f["name"] for f in needed} == {"python", "packages", "physics"}
    assert record["ok"] == all(f["ok"] for f in needed) == (code == 0)
    assert code == 0, needed
    assert all(f["fix"] for f in record["findings"] if not f["ok"])


def test_wrong_version_of_a_needed_package_fails_and_names_both(monkeypatch):
    true = metadata.version
    monkeypatch.setattr(doctor.metadata, "version", lambda name: "3.1.0" if name == "mujoco" else true(name))
    base = next(f for f in doctor._packages() if f.name == "packages")
    assert base.needed and not base.ok
    assert "mujoco 3.1.0, needed" in base.detail and "4.0" in base.detail


def test_missing_extra_is_not_a_failure(monkeypatch):
    def version(name):
        if name == "rosbags":
            raise metadata.PackageNotFoundError(name)
        return "4.0.1" if name == "mujoco" else "999"

    monkeypatch.setattr(doctor.metadata, "version", version)
    logs = next(f for f in doctor._packages() if f.name == "extra 'logs'")
    assert not logs.ok and not logs.needed and "rosbags is not installed" in logs.detail and "logs" in logs.fix


def test_table_marks_and_exit_codes(monkeypatch, capsys):
    optional = Finding("gpu", False, "none", fix="buy one")
    monkeypatch.setattr(doctor, "examine", lambda: [Finding("python", True, "3", True), optional])
    assert Args().run() == 0
    shown = capsys.readouterr().out
    assert "Ready." in shown and "-> buy one" in shown and "FAIL" not in shown
    monkeypatch.setattr(doctor, "examine", lambda: [Finding("physics", False, "no", True, "install it"), optional])
    assert Args().run() == 1
    shown = capsys.readouterr().out
    assert "FAIL  physics" in shown and "Not ready" in shown


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
