"""The laws of what happens to light and colour in a camera, against closed forms."""

from __future__ import annotations

import colorsys

import numpy as np
import pytest
from camera_images import SIZE, F, K, apply, busy, plane

from vispeg.core.lens import distort
from vispeg.core.seeds import stream
from vispeg.effects.camera.timing.motion_blur import line_kernel
from vispeg.effects.common.light import LUMA, to_linear, to_srgb


def coloured(seed: int = 0, low: float = 0.1, high: float = 0.6):
    frame = plane(0.3)
    frame.rgb = stream(seed, "colours").uniform(low, high, frame.rgb.shape).astype(np.float32)
    return frame


def point():
    """One white pixel on black at the centre."""
    frame = plane(0.3, size=65)
    frame.rgb[:] = 0
    frame.rgb[0, 32, 32] = 1
    return frame


def moments(image: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Sum, mean (v, u) and covariance (2, 2) of an image taken as a distribution of light."""
    grid = np.stack(np.mgrid[: image.shape[0], : image.shape[1]], -1).reshape(-1, 2).astype(float)
    w = image.ravel().astype(float)
    mean = w @ grid / w.sum()
    return float(w.sum()), mean, (grid - mean).T @ ((grid - mean) * w[:, None]) / w.sum()


def test_the_transfer_curve_is_that_of_the_standard_and_its_own_inverse():
    for encoded, linear in ((0.0, 0.0), (0.04045, 0.0031308), (0.5, 0.21404114), (0.735357, 0.5), (1.0, 1.0)):
        assert abs(float(to_linear(np.float32([[encoded]]))[0, 0]) - linear) < 2e-6
        assert abs(float(to_srgb(np.float32([[linear]]))[0, 0]) - encoded) < 2e-5
    x = np.linspace(0, 1, 4097, dtype=np.float32)
    np.testing.assert_allclose(to_srgb(to_linear(x)), x, atol=2e-6)


def test_exposure_and_white_balance_scale_light():
    given = coloured(high=0.5)
    light = to_linear(given.rgb)
    out = apply("exposure", coloured(high=0.5), stops=1.0)
    np.testing.assert_allclose(to_linear(out.rgb), 2 * light, atol=2e-5)
    back = apply("exposure", out, stops=-1.0)
    np.testing.assert_allclose(back.rgb, given.rgb, atol=2e-5)
    out = apply("white_balance", coloured(high=0.5), red=1.25, blue=0.8)
    np.testing.assert_allclose(to_linear(out.rgb), light * (1.25, 1, 0.8), atol=2e-5)
    full = to_linear(coloured().rgb) > 1 / 16
    np.testing.assert_allclose(apply("exposure", coloured(), stops=4.0).rgb[full], 1, atol=1e-6)


def test_vignette_is_the_fourth_power_of_the_cosine():
    light = (
        to_linear(apply("vignetting", plane(0.3), amount=1.0).rgb)[0, ..., 0] / to_linear(plane(0.3).rgb)[0, 0, 0, 0]
    )
    x, y = (np.arange(SIZE) - 31.5) / F, (np.arange(SIZE)[:, None] - 31.5) / F
    np.testing.assert_allclose(light, np.cos(np.arctan(np.hypot(x, y))) ** 4, rtol=1e-4)


def test_brightness_saturation_and_hue():
    given = coloured().rgb
    np.testing.assert_allclose(apply("brightness", coloured(), change=0.3).rgb, given * 1.3, rtol=1e-6)
    more = apply("saturation", coloured(low=0.3), change=0.2).rgb
    np.testing.assert_allclose(more @ LUMA, coloured(low=0.3).rgb @ LUMA, atol=1e-6)  # luma stays
    grey = apply("saturation", coloured(), change=-1.0).rgb
    np.testing.assert_allclose(grey, np.repeat((given @ LUMA)[..., None], 3, -1), atol=1e-6)
    turned = apply("hue", coloured(), turn=0.2).rgb
    np.testing.assert_allclose(turned.max(-1), given.max(-1), atol=1e-5)  # value and chroma stay
    np.testing.assert_allclose(turned.min(-1), given.min(-1), atol=1e-5)
    for v, u in ((0, 0), (10, 20), (40, 5)):
        h, s, value = colorsys.rgb_to_hsv(*given[0, v, u].tolist())
        np.testing.assert_allclose(turned[0, v, u], colorsys.hsv_to_rgb((h + 0.2) % 1, s, value), atol=1e-4)
    np.testing.assert_allclose(apply("hue", plane(0.3), turn=0.3).rgb, 0.5, atol=1e-6)  # grey has no hue


def test_noise_has_a_part_that_grows_with_light():
    """Variance shot I + read^2 in linear light, at several lights at once."""
    for value in (0.3, 0.5, 0.7):
        frame = plane(0.3, 4)
        frame.rgb[:] = value
        light = to_linear(np.float32([[value]]))[0, 0]
        out = to_linear(apply("rgb_noise", frame, shot=0.001, read=0.01).rgb).astype(float)
        assert abs(out.mean() - light) < 1e-3
        assert abs(out.var() / (0.001 * light + 1e-4) - 1) < 0.03


@pytest.mark.parametrize("sigma", [0.7, 1.5, 3.0])
def test_blur_spreads_a_point_and_keeps_its_light(sigma):
    total, mean, covariance = moments(to_linear(apply("blur", point(), sigma=sigma).rgb)[0, ..., 0])
    assert abs(total - 1) < 0.02 and np.abs(mean - 32).max() < 1e-3
    np.testing.assert_allclose(covariance, np.eye(2) * sigma**2, atol=0.06 * sigma**2)


@pytest.mark.parametrize("degrees", [0, 30, 90, 200])
def test_motion_blur_draws_a_line(degrees):
    """A point becomes a line of length L: variance L^2 / 12 along it, none across but for the pixels' own."""
    length, angle = 9.0, np.deg2rad(degrees)
    total, mean, covariance = moments(line_kernel(length * np.cos(angle), length * np.sin(angle)))
    along, across = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])  # (v, u)
    r = (len(line_kernel(length * np.cos(angle), length * np.sin(angle))) - 1) / 2
    assert abs(total - 1) < 1e-6 and np.abs(mean - r).max() < 1e-6
    assert 0 <= along @ covariance @ along - length**2 / 12 < 0.3  # a pixel's own width adds at most 1/4
    assert across @ covariance @ across < 0.26


def test_motion_blur_follows_the_camera():
    """Sideways at 0.5 m/s for 10 ms, 0.3 m away: f v t / z px; turning instead: f w t; twice as far: half of it."""

    def extent(z: float, v: list[float]) -> np.ndarray:
        frame = point()
        frame.depth[:] = z
        frame.velocity = np.array([v], float)
        out = apply("motion_blur", frame, exposure=0.02)
        _, _, covariance = moments(to_linear(out.rgb)[0, ..., 0])
        return np.sqrt(12 * np.diag(covariance))  # (v, u)

    for z in (0.15, 0.3):
        assert abs(extent(z, [1.0, 0, 0, 0, 0, 0])[1] - F * 0.02 / z) < 0.35
    assert abs(extent(0.3, [0, 0, 0, 3.0, 0, 0])[0] - F * 3.0 * 0.02) < 0.4
    assert abs(extent(0.3, [0, 1.0, 0, 1 / 0.3, 0, 0])).max() < 0.1  # turning and moving that cancel at the centre


def test_jpeg_is_an_eighth_of_the_picture_at_a_time():
    """Errors grow with the loss, a flat picture stays, and every channel stays with its own."""
    errors = [np.abs(apply("jpeg", busy(1), loss=q).rgb - busy(1).rgb).mean() for q in (5.0, 20.0, 40.0)]
    assert 0 < errors[0] < errors[1] < errors[2]
    frame = plane(0.3)
    frame.rgb[:] = (0.8, 0.4, 0.2)
    np.testing.assert_allclose(
        apply("jpeg", frame, loss=10.0).rgb, np.broadcast_to((0.8, 0.4, 0.2), (1, 64, 64, 3)), atol=0.02
    )


@pytest.mark.parametrize("seed", range(5))
def test_occlusion_covers_the_stated_area(seed):
    frame = apply("occlusion", plane(0.3), area=0.15, count=1, seed=float(seed))
    hidden = frame.depth[0] == 0
    assert abs(hidden.mean() - 0.15) < 0.02
    v, u = np.nonzero(hidden)
    assert hidden[v.min() : v.max() + 1, u.min() : u.max() + 1].all()  # a rectangle
    assert len(np.unique(frame.rgb[0][hidden], axis=0)) == 1 and (frame.rgb[0][~hidden] == 0.5).all()
    labelled = plane(0.3)
    labelled.parts = np.full(labelled.depth.shape, 7, np.uint8)
    parts = apply("occlusion", labelled, area=0.15, count=1, seed=float(seed)).parts[0]
    np.testing.assert_array_equal(parts, np.where(hidden, 0, 7))  # a hidden pixel shows none
    three = apply("occlusion", plane(0.3), area=0.15, count=3, seed=float(seed)).depth == 0
    assert 0.05 < three.mean() < 0.17


def test_a_distorted_image_shows_points_where_the_lens_puts_them():
    """A smooth spot at a known ray appears at K distort(ray), in colour and in depth, and the edge shows no depth."""
    values = {"k1": 0.15, "k2": 0.02, "p1": 0.005, "p2": -0.004}
    u0, v0 = 54.0, 10.0
    frame = plane(0.3)
    grid_v, grid_u = np.mgrid[:SIZE, :SIZE]
    light = np.exp(-((grid_u - u0) ** 2 + (grid_v - v0) ** 2) / 8)
    frame.rgb[0] = light[..., None]
    frame.depth[0] = 0.5 + light
    out = apply("lens_distortion", frame, **values)
    xd, yd = distort(np.array([u0 - 31.5, v0 - 31.5]) / F, (*values.values(), 0.0))
    where = np.array([yd * F + 31.5, xd * F + 31.5])
    for image, tolerance in ((out.rgb[0, ..., 0], 0.1), (np.where(out.depth[0] > 0, out.depth[0] - 0.5, 0), 0.35)):
        _, mean, _ = moments(np.where(image > 0.2, image, 0))
        assert np.abs(mean - where).max() < tolerance, (mean, where)
    assert np.hypot(*(where - (v0, u0))) > 0.5
    barrel = apply("lens_distortion", plane(0.3), k1=-0.2).depth[0]
    assert barrel[0, 0] == 0 and barrel[32, 32] > 0 and np.allclose(K[0, 2], 31.5)
