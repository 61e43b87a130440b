"""Intrinsics: exact from exact corners, within their intervals from noisy ones, refused where nothing fixes them."""

import numpy as np
import pytest
from board_views import BOARD, LENS, flange, seen

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.render.calibration import calibrate


def test_exact_corners_give_the_camera_back():
    views, _ = seen(stream(1, "exact"), 8, noise=0.0)
    found = calibrate(views, BOARD)
    assert np.allclose(found.camera.focal, LENS.focal, rtol=1e-5)
    assert np.allclose(found.camera.centre, LENS.centre, atol=0.01)
    assert np.allclose(found.camera.distortion, LENS.distortion, atol=1e-3)
    assert found.fit_pixels.max() < 1e-3 and found.hand_eye is None
    camera = found.to_camera("eye")
    assert (camera.width, camera.height, camera.fx) == (640, 480, found.camera.focal[0])


def test_intervals_hold_the_truth():
    """About 95 % of them; pooled over eight numbers of each of fifteen calibrations, which are not independent."""
    inside, width = [], []
    for seed in range(15):
        views, _ = seen(stream(seed, "intrinsics"), 10)
        found = calibrate(views, BOARD)
        assert found.intrinsics_half is not None
        inside.append(np.abs(found.camera.values - LENS.values)[:8] < found.intrinsics_half[:8])
        width.append(found.intrinsics_half[0])
    assert 0.90 <= np.mean(inside) <= 1.0
    assert np.median(width) < 6  # px of 600: not bought by being wide


def test_terms_held_at_zero_stay_there():
    views, _ = seen(stream(2, "held"), 6)
    for distortion, free in (("none", ()), ("radial", (0, 1)), ("brown5", (0, 1, 2, 3, 4))):
        found = calibrate(views, BOARD, distortion=distortion)
        held = [i for i in range(5) if i not in free]
        assert found.intrinsics_half is not None
        assert np.all(np.array(found.camera.distortion)[held] == 0) and np.all(found.intrinsics_half[4:][held] == 0)
        assert np.all(np.array(found.camera.distortion)[list(free)] != 0)


def test_views_that_do_not_fix_the_focal_length_are_refused():
    views, _ = seen(stream(3, "flat"), 8, tilt=0.3)
    with pytest.raises(UserError, match="do not fix the focal length.*tilted"):
        calibrate(views, BOARD)
    views, _ = seen(stream(3, "few"), 3)
    with pytest.raises(UserError, match="too few images.*4 or more.*got 3"):
        calibrate(views, BOARD)


def test_given_intrinsics_are_kept_and_must_fit_the_images():
    views, poses = seen(stream(4, "given"), 6)
    found = calibrate(views, BOARD, camera=LENS, flange=flange(poses))
    assert found.camera is LENS and found.intrinsics is None and found.intrinsics_half is None
    other = type(LENS)((1280, 960), LENS.focal, LENS.centre)
    with pytest.raises(UserError, match="another image size"):
        calibrate(views, BOARD, camera=other)
