"""A real camera on a real flange: the figures that others have published for the same eight images."""

import os
from pathlib import Path

import numpy as np
import pytest

from vispeg.render.calibration import Board, calibrate, detect, read_poses
from vispeg.render.calibration.hand_eye import solve
from vispeg.render.calibration.known import read_intrinsics
from vispeg.render.calibration.results import notes, record

SHARED = Path(os.environ.get("VISPEG_SHARED", Path(__file__).resolve().parents[3] / "shared"))
IMAGES = SHARED / "data" / "franka-handeye"
pytestmark = pytest.mark.skipif(not IMAGES.is_dir(), reason="the shared images are not here")
BOARD = Board("chessboard", 9, 6, 0.0236)


@pytest.fixture(scope="module")
def views():
    found, missed = detect(IMAGES, BOARD)
    assert len(found) == 8 and not missed and all(len(view.ids) == 54 for view in found)
    return found


def test_reference_figures(views):
    """Factory intrinsics: reprojection 0.28-0.55 px, the camera at (0.057, -0.034, -0.042) m, scatter 5.4 mm RMS."""
    flange = read_poses(IMAGES, [view.name for view in views])
    found = calibrate(views, BOARD, camera=read_intrinsics(IMAGES / "franka_camera.xml"), flange=flange)
    eye, half = found.hand_eye, found.hand_eye_half
    assert eye is not None and half is not None
    assert 0.27 < found.fit_pixels.min() and found.fit_pixels.max() < 0.56
    assert np.abs(eye.camera[:3, 3] - [0.057, -0.034, -0.042]).max() < 1.5e-3
    assert 1e3 * eye.scatter == pytest.approx(5.4, abs=0.05)
    assert eye.misfit.max() < 2 and 2e-3 < half[:3].max() < 8e-3
    for name in ("PARK", "HORAUD", "DANIILIDIS", "TSAI"):  # the closed forms lie inside the interval
        assert np.all(np.abs(eye.methods[name][:3, 3] - eye.camera[:3, 3]) < half[:3])


def test_the_robots_motion_doubts_the_stated_square(views):
    """With squares of 26.8 mm in place of the stated 23.6 the board scatters half as much, and the notes say so."""
    flange = read_poses(IMAGES, [view.name for view in views])
    camera = read_intrinsics(IMAGES / "franka_camera.xml")
    stated = calibrate(views, BOARD, camera=camera, flange=flange)
    larger = solve(views, Board("chessboard", 9, 6, 0.0268), camera, flange, "flange")
    assert stated.hand_eye is not None
    assert any("times as large: --square?" in line for line in notes(stated, {}))
    (named,) = record(stated, BOARD, {})["effects"]
    assert named["effect"] == "board_scale" and named["params"]["factor"]["value"] == pytest.approx(1.134, abs=2e-3)
    assert named["params"]["factor"]["low"] > 1.05 and named["robot_error_mm"][1] < 0.3 * named["robot_error_mm"][0]
    assert larger.scatter < 0.6 * stated.hand_eye.scatter and abs(larger.scale[0] - 1) < larger.scale[1]


def test_own_intrinsics_come_near_the_factorys(views):
    """Within two of the intervals, which say nothing of the factory's own errors; the board fits better with them."""
    found = calibrate(views, BOARD)
    factory = read_intrinsics(IMAGES / "franka_camera.xml")
    assert found.intrinsics_half is not None
    assert np.all(np.abs(found.camera.values - factory.values)[:4] < 2 * found.intrinsics_half[:4])
    assert found.fit_pixels.max() < 0.4
