"""Depth and light of pictures with known errors: the figures are what was put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vispeg.render.cameras.camera import Camera
from vispeg.vision.depth import BASELINE, depth_quality, depth_residual
from vispeg.vision.eye import Eye
from vispeg.vision.photometry import light_residual
from vispeg.vision.predict import TO_LINEAR, Rendering, encoded

CAMERA = Camera("eye", 160, 120, 150.0, 150.0, 79.5, 59.5)
TILT = np.array([0.3, -0.2, 1.0])  # of a plane n . p = d
FLAT, BOX = 1, 2


@pytest.fixture
def seen():
    """A tilted table with a box before it, in two colours that grow brighter to the right."""
    rays = CAMERA.rays()
    depth = 0.5 / (rays @ TILT)
    parts = np.full(depth.shape, FLAT, np.int32)
    parts[40:80, 60:110], depth[40:80, 60:110] = BOX, 0.3
    light = (
        np.linspace(0.05, 0.4, 160)[None, :, None]
        * np.array([1.0, 0.8, 0.5])
        * np.where(parts == BOX, 0.5, 1)[..., None]
    )
    return Rendering(Eye(CAMERA, CAMERA), np.zeros(1), encoded(light), depth.astype(np.float32), parts, np.eye(4))


def test_scale_bias_and_noise_of_depth(seen):
    rng = np.random.default_rng(0)
    truth = seen.depth.astype(float)
    for measured, accuracy in ((truth, 0.0), (1.02 * truth, 2.0)):
        residual = depth_residual(measured, seen)
        quality = depth_quality(measured, seen, residual, FLAT)
        assert quality.z_accuracy == pytest.approx(accuracy, abs=1e-3)
        assert quality.fill_rate == 100.0 and quality.plane_fit_rms_mm == pytest.approx(0.0, abs=1e-3)
    noise = 0.002 * truth**2 / 0.25  # grows with z^2, as a stereo camera's
    measured = truth + noise * rng.standard_normal(truth.shape)
    residual = depth_residual(measured, seen)
    quality = depth_quality(measured, seen, residual, FLAT)
    flat = residual.interior & (seen.parts == FLAT)
    normal = 1 / np.linalg.norm(TILT)  # the error along the ray, seen along the plane's normal
    cosine = (CAMERA.rays()[flat] @ TILT) * normal
    expected = 1e3 * np.sqrt(np.mean((noise[flat] * cosine) ** 2))
    assert quality.plane_fit_rms_mm == pytest.approx(expected, rel=0.05)
    disparity = 0.002 / 0.25 * CAMERA.fx * BASELINE
    assert quality.subpixel_rms == pytest.approx(disparity, rel=0.05)


def test_holes_and_borders_are_apart_from_the_interior(seen):
    """A fattened edge shows in the band alone; what has no reading is a hole, not an error."""
    measured = seen.depth.copy()
    measured[38:82, 58:112] = np.minimum(measured[38:82, 58:112], 0.3)
    measured[10:20, 10:20] = 0
    residual = depth_residual(measured, seen)
    assert not (residual.interior & residual.band).any()
    assert np.nanmax(np.abs(residual.error[residual.interior])) == 0.0
    assert np.nanmin(residual.error[residual.band]) < -0.1
    assert residual.missing.sum() == 100 and np.isnan(residual.error[15, 15])
    inside = residual.interior[10:20, 10:20].sum()
    fill = depth_quality(measured, seen, residual, FLAT).fill_rate
    assert fill == pytest.approx(100 * (1 - inside / residual.interior.sum()))


def test_without_interior_pixels_there_is_no_fill_rate(seen):
    empty = replace(seen, depth=np.zeros_like(seen.depth))
    quality = depth_quality(seen.depth, empty, depth_residual(seen.depth, empty), FLAT)
    assert quality.fill_rate is None and quality.distance is None


def test_gain_and_offset_are_no_error_and_vignetting_is(seen):
    gain, offset = np.array([1.4, 0.9, 1.2]), 0.01
    measured = encoded((TO_LINEAR[seen.rgb] * gain + offset).astype(np.float32))
    found = light_residual(measured, seen)
    assert np.allclose(found.gain, gain, rtol=0.02) and np.allclose(found.offset, offset, atol=0.003)
    assert np.nanmax(np.abs(found.error)) < 3 and found.inlier > 0.9
    u, v = np.meshgrid(np.arange(160), np.arange(120))
    fall = 1 - 0.5 * ((u - 79.5) ** 2 + (v - 59.5) ** 2) / 10000
    dark = light_residual(encoded((TO_LINEAR[seen.rgb] * fall[..., None]).astype(np.float32)), seen)
    assert np.nanmean(np.abs(dark.error)) > 3 * np.nanmean(np.abs(found.error))


def test_a_thing_that_the_model_lacks_does_not_bend_the_fit(seen):
    measured = seen.rgb.copy()
    measured[:30, :30] = 200
    assert np.allclose(light_residual(measured, seen).gain, 1.0, atol=0.02)


def test_saturated_pixels_say_nothing(seen):
    measured = seen.rgb.copy()
    measured[50:60] = 255
    found = light_residual(measured, replace(seen, rgb=seen.rgb))
    assert np.isnan(found.error[50:60]).all() and np.isfinite(found.error[70]).all()
