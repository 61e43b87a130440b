"""`vispeg effects`: every effect is listed with what a user needs, and one is explained, and drawn where asked."""

import json
import os
import subprocess
import sys

import cv2
import numpy as np
import pytest

from vispeg.api.library.effect_picture import draw_effect
from vispeg.cli.main import BLAS_THREADS, main
from vispeg.core.effect import REGISTRY, effect
from vispeg.identify.signature import signature
from vispeg.report.drawings.look import SIZE, looks
from vispeg.robots.scene import build


def test_every_effect_is_listed_with_its_parameters(vispeg):
    code, out, _ = vispeg("effects")
    assert code == 0
    listed = {line.split()[0] for line in out.splitlines() if line.strip()}
    assert set(REGISTRY) <= listed
    code, out, _ = vispeg("effects", "--json")
    found = {row["name"]: row for row in json.loads(out)["effects"]}
    assert set(found) == set(REGISTRY)
    for name, row in found.items():
        assert row["summary"] and row["description"] and row["where"]
        assert set(row["params"]) == set(REGISTRY[name].params)
        for key, p in row["params"].items():
            param = REGISTRY[name].params[key]
            assert (p["low"], p["high"], p["unit"]) == (param.low, param.high, param.unit)
            assert p["null"] == (None if param.shape else param.null)


def test_one_effect_is_explained_and_drawn_only_where_asked(vispeg, tmp_path):
    code, out, _ = vispeg("effects", "coulomb_friction")
    assert code == 0 and "sign(dq)" in out and "N m" in out
    assert not list(tmp_path.iterdir()), "nothing is dropped where the user stands"
    assert vispeg("effects", "coulomb_friction", "--out", ".")[0] == 0
    picture = tmp_path / "effect-coulomb_friction.png"
    first = picture.read_bytes()
    assert first.startswith(b"\x89PNG")
    picture.write_bytes(first + b"mine")
    code, out, _ = vispeg("effects", "coulomb_friction", "--out", ".")
    assert code == 0 and "sign(dq)" in out and "--overwrite" in out, "explained also when its picture is there"
    assert picture.read_bytes() == first + b"mine"
    assert vispeg("effects", "coulomb_friction", "--out", ".", "--overwrite")[0] == 0
    assert picture.read_bytes() == first


def test_each_place_has_its_own_picture(vispeg, tmp_path):
    for where in ("joint2", "joint6"):
        assert vispeg("effects", "coulomb_friction", "--where", where, "--out", ".")[0] == 0
    first, second = (tmp_path / f"effect-coulomb_friction-{where}.png" for where in ("joint2", "joint6"))
    assert first.read_bytes() != second.read_bytes()


@pytest.mark.parametrize(
    ("name", "where"), [("block_matching", None), ("rolling_shutter", None), ("camera_offset", "wrist_crop")]
)
def test_a_picture_shows_what_a_camera_s_effect_changes(tmp_path, name, where):
    """Also depth by matching, what needs motion, and a camera that is not among the usual two."""
    drawn = draw_effect(name, tmp_path, where=where)
    assert drawn.path is not None and cv2.imread(str(drawn.path)).shape[1] > 4 * SIZE
    placed, *both = looks(effect(name), where, build())
    assert [view.camera for view in both[0]] == ["external", where or "wrist_wide"]
    without, seen = (np.stack([[v.colour, v.depth] for v in views]).astype(int) for views in both)
    assert placed.effect == name and (np.abs(without - seen) > 8).mean() > 1e-3


@pytest.mark.parametrize(("name", "where"), [("camera_delay", None), ("part_colour", "arm")])
def test_what_no_single_picture_shows_is_not_drawn(tmp_path, name, where):
    drawn = draw_effect(name, tmp_path, where=where)
    assert drawn.path is None and "changes nothing" in drawn.line and not list(tmp_path.iterdir())


def test_picture_of_friction_shows_the_servo_deflected_by_friction():
    """At constant speed a servo lags by friction / stiffness: 0.5 N m over the joint's 400 N m/rad, either way."""
    s = signature("coulomb_friction", "joint4")
    assert s.joint == "joint4"
    size = np.abs(s.deviation[500:])
    assert np.median(size) == pytest.approx(0.5 / 400.0, rel=0.15)
    assert s.deviation.min() < -1e-3 and s.deviation.max() > 1e-3
    fast = np.abs(s.speed[500:]) > 0.05
    agree = np.sign(s.torque[500:][fast]) == np.sign(s.speed[500:][fast])
    assert agree.mean() > 0.8, "over speed, the torque that friction costs is a step"


def test_no_effect_no_picture(refused):
    refused(["effects", "coulomb"], "unknown effect", "did you mean 'coulomb_friction'")
    refused(["effects", "payload", "--where", "joint3", "--out", "."], "no such place", "flange")
    refused(["effects", "payload", "--where", "flange"], "--where", "--out")
    refused(["effects", "--out", "pictures"], "--out", "NAME")


def test_a_command_works_with_one_blas_thread_unless_it_is_told_otherwise(monkeypatch, capsys):
    """Threads of small problems only wait for one another; what the user sets stays."""
    monkeypatch.delenv(BLAS_THREADS, raising=False)
    assert main(["effects", "payload"]) == 0 and os.environ[BLAS_THREADS] == "1"
    monkeypatch.setenv(BLAS_THREADS, "3")
    assert main(["effects", "payload"]) == 0 and os.environ[BLAS_THREADS] == "3"
    code = "import sys, vispeg.cli.main; assert 'numpy' not in sys.modules, 'too late to say how many threads it has'"
    subprocess.run([sys.executable, "-c", code], check=True)
