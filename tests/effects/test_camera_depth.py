"""The laws of a depth sensor's faults, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from camera_images import SIZE, F, apply, plane, step
from scipy.stats import kurtosis

from vispeg.core.seeds import stream
from vispeg.effects.camera.depth.grazing_holes import facing
from vispeg.effects.common.field import correlated, normal

FB = 425.0 * 0.05  # px m, the matcher's by default


def lost(frame) -> np.ndarray:
    return frame.depth == 0


def test_the_shadow_falls_to_the_left_and_is_as_wide_as_the_disparities_differ():
    """F B (1 / z_near - 1 / z_far) px beside the near post, on the side away from the second eye."""
    near, far, baseline = 0.2, 0.4, 0.05
    width = F * baseline * (1 / near - 1 / far)  # 7.5 px
    right_eye = lost(apply("stereo_shadow", step(near, far), baseline=baseline))[0]
    expected = np.zeros((SIZE, SIZE), bool)
    expected[:, 24 - 7 : 24] = True
    assert width == 7.5 and np.array_equal(right_eye, expected)
    left_eye = lost(apply("stereo_shadow", step(near, far), baseline=-baseline))[0]
    expected[:] = False
    expected[:, 40 : 40 + 7] = True
    assert np.array_equal(left_eye, expected)


@pytest.mark.parametrize("baseline", [0.018, 0.03, 0.075])
def test_shadow_and_readings_against_a_search_over_pairs(baseline):
    """An obvious oracle: a pixel is hidden if another one to its right lands left of it in the second image."""
    rng = stream(1, "relief")
    frame = plane(0.3)
    frame.depth[0] = np.kron(rng.uniform(0.15, 0.6, (8, 8)), np.ones((8, 8)))
    d = F * baseline / frame.depth[0].astype(float)
    at = np.arange(SIZE) - d
    hidden = np.array(
        [[any(at[v, w] < at[v, u] - 0.05 for w in range(u + 1, SIZE)) for u in range(SIZE)] for v in range(SIZE)]
    )
    given = frame.depth.copy()
    out = apply("stereo_shadow", frame, baseline=baseline)
    assert 0.01 < hidden.mean() < 0.6
    np.testing.assert_array_equal(out.depth[0], np.where(hidden, 0, given[0]))


def test_a_smooth_surface_has_no_shadow_and_the_band_is_as_wide_as_the_disparity():
    """A plane that leans by 45 degrees is seen whole by both eyes; with the band, f B / z px are lost on the left."""
    frame = plane(0.3)
    frame.depth += (0.3 * np.arange(SIZE) / F).astype(np.float32)
    assert not lost(apply("stereo_shadow", frame, baseline=0.05)).any()
    band = lost(apply("stereo_shadow", plane(0.3), baseline=0.05, band=1.0))[0]
    assert band[:, : round(F * 0.05 / 0.3)].all() and not band[:, round(F * 0.05 / 0.3) + 1 :].any()


def test_axial_noise_grows_with_the_square_of_the_distance():
    """sigma_z = sd z^2 / (f B): slope 2 on log-log, and the right size."""
    z = np.array([0.1, 0.2, 0.4, 0.8])
    spread = np.array([np.std(apply("disparity_noise", plane(d, 8), sd=0.1).depth / d - 1) * d for d in z])
    slope = np.polyfit(np.log(z), np.log(spread), 1)[0]
    assert abs(slope - 2) < 0.03
    np.testing.assert_allclose(spread, 0.1 * z**2 / FB, rtol=0.04)


def test_noise_is_in_disparity_and_unbiased_there():
    """Depth's own distribution is skewed, 1/z is not; the low-pass leaves the variance at one and at the border."""
    out = apply("disparity_noise", plane(0.5, 16), sd=0.5, length=2.0)
    d = FB / out.depth.astype(float)
    assert abs(d.mean() - FB / 0.5) < 0.06 and abs(d.std() / 0.5 - 1) < 0.05
    fields = np.stack([correlated(stream(i, "field"), (32, 32), 2.0) for i in range(400)]).astype(float)
    variance = fields.var(axis=0)
    assert (
        abs(variance.mean() - 1) < 0.03 and abs(variance[0].mean() - 1) < 0.1 and abs(variance[:, -1].mean() - 1) < 0.1
    )
    for lag in (1, 2, 4):  # correlation of white noise after a Gaussian of 2 px
        measured = np.mean(fields[:, :, lag:] * fields[:, :, :-lag])
        assert abs(measured - np.exp(-(lag**2) / (4 * 2.0**2))) < 0.03


def test_the_quick_normal_numbers_are_normal():
    x = normal(stream(0, "normal"), (500_000,)).astype(float)
    assert abs(x.mean()) < 5e-3 and abs(x.std() - 1) < 5e-3 and abs(kurtosis(x)) < 0.03
    assert abs(np.mean(np.abs(x) > 3) - 0.0027) < 3e-4
    assert abs(np.mean(x[:-1] * x[1:])) < 5e-3


def test_quantized_depth_is_the_nearest_of_the_steps():
    frame = plane(0.3)
    frame.depth[0] = np.linspace(0.15, 1.5, SIZE * SIZE).reshape(SIZE, SIZE)
    given = frame.depth[0].astype(float)
    out = apply("disparity_quantization", frame, step=0.25).depth[0].astype(float)
    counts = FB / out / 0.25
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-3)
    assert np.abs(FB / out - FB / given).max() <= 0.125 + 1e-4
    assert np.abs(out - given).max() > 0.01  # at 1.5 m a quarter of a pixel is 26 mm
    assert lost(apply("disparity_quantization", plane(100.0), step=1.0)).all()  # 0.2 px of disparity: none


def test_edges_grow_by_half_the_window_on_each_side():
    """Matched at the image's own focal length; a border as wide as the half window is left alone."""
    inner = slice(5, -5)

    def wide(window: float, reject: float = 0.0) -> np.ndarray:
        out = apply("edge_fattening", step(0.2, 0.4), window=window, reject=reject, focal=F)
        return np.isclose(out.depth[0, inner], 0.2)

    assert wide(6.0)[:, 21:43].all() and wide(6.0).sum() == (SIZE - 10) * 22
    assert abs(wide(7.0).sum() / (SIZE - 10) - 23) < 0.5  # half a pixel more on each side, given to half of the pixels
    rejected = lost(apply("edge_fattening", step(0.2, 0.4), window=6.0, reject=1.0, focal=F))[0, inner]
    assert np.array_equal(rejected, wide(6.0) & (step(0.2, 0.4).depth[0, inner] > 0.3))
    shallow = step(0.39, 0.4)
    given = shallow.depth.copy()
    np.testing.assert_array_equal(apply("edge_fattening", shallow, window=6.0, focal=F).depth, given)  # no edge


def test_a_steep_plane_has_no_edge():
    """Its disparity falls by 3 px of the matcher from one row to the next: that is a slope, not a step."""
    frame = plane(0.3)
    frame.depth[0] = (FB / (300 - np.arange(SIZE)[:, None] * 3.0 - np.arange(SIZE))).astype(np.float32)
    given = frame.depth.copy()
    np.testing.assert_array_equal(apply("edge_fattening", frame, window=9.0, reject=1.0).depth, given)


def test_jitter_takes_readings_from_beside():
    """A plane stays; a slope reads as from a place N(0, sd) away, rounding included; an edge holds two depths only."""
    given = plane(0.3).depth
    np.testing.assert_array_equal(apply("lateral_jitter", plane(0.3), sd=0.7).depth, given)
    slope = plane(1.0, 8)
    slope.depth += np.arange(SIZE, dtype=np.float32)
    moved = (apply("lateral_jitter", slope, sd=0.7).depth - 1 - np.arange(SIZE))[:, :, 8:-8]
    assert abs(moved.mean()) < 0.02 and abs(moved.var() - (0.7**2 + 1 / 12)) < 0.02
    assert set(np.unique(apply("lateral_jitter", step(0.2, 0.4), sd=0.7).depth)) == {np.float32(0.2), np.float32(0.4)}


@pytest.mark.parametrize(("sd", "moved"), [(0.115, 0.0), (0.2, 0.025), (0.3, 0.18), (0.4, 0.38)])
def test_a_small_jitter_moves_as_many_pixels_as_stated(sd, moved):
    slope = plane(1.0, 8)
    slope.depth += np.arange(SIZE, dtype=np.float32) + 1000 * np.arange(SIZE, dtype=np.float32)[:, None]
    given = slope.depth.copy()
    changed = apply("lateral_jitter", slope, sd=sd).depth != given
    assert abs(changed[:, 2:-2, 2:-2].mean() - moved) < 0.012


@pytest.mark.parametrize("grey", [0.05, 0.1, 0.2])
def test_dark_surfaces_lose_readings_by_the_square_of_their_luma(grey):
    frame = plane(0.3, 32)
    frame.rgb[:] = grey
    share = lost(apply("grazing_holes", frame, dark=0.8)).mean()
    assert abs(share - 0.8 * max(0, 1 - grey**2 / 0.05)) < 0.02


def test_what_is_too_near_is_lost():
    frame = apply("near_limit", step(0.12, 0.4), nearest=0.17)
    assert np.array_equal(lost(frame)[0], step(0.12, 0.4).depth[0] < 0.17)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 75.0])
def test_the_angle_of_a_surface_is_found_from_its_depth(degrees):
    """A plane turned about the vertical: its true normal and each pixel's ray give the cosine."""
    n = np.array([np.sin(np.deg2rad(degrees)), 0, -np.cos(np.deg2rad(degrees))])
    frame = plane(0.3)
    x, y = (np.arange(SIZE) - 31.5) / F, (np.arange(SIZE)[:, None] - 31.5) / F
    ray = np.stack(np.broadcast_arrays(x, y, 1.0), -1)
    z = 0.3 * n[2] / (ray @ n)
    seen = (z > 0.05) & (z < 3)
    frame.depth[0] = np.where(seen, z, 0)
    frame.truth = frame.depth
    true = np.abs(ray @ n) / np.linalg.norm(ray, axis=-1)
    inside = seen[:, 2:] & seen[:, :-2] & seen[:, 1:-1]
    inside = np.pad(inside, ((0, 0), (1, 1)))
    np.testing.assert_allclose(facing(frame, 0)[inside], true[inside], atol=0.02)
    frame.normals = np.broadcast_to(n, (1, SIZE, SIZE, 3)).astype(np.float32)
    np.testing.assert_allclose(facing(frame, 0)[seen], true[seen], atol=1e-5)


def test_holes_are_as_frequent_as_stated():
    """Anywhere: `blobs`. On black: `dark`. In a highlight: `shine`. On a plane seen at `angle`: half of `grazing`."""
    assert abs(lost(apply("grazing_holes", plane(0.3, 32), blobs=0.1)).mean() - 0.1) < 0.01
    for value, name in ((0.0, "dark"), (1.0, "shine")):
        frame = plane(0.3, 32)
        frame.rgb[:, :, :32] = value
        holes = lost(apply("grazing_holes", frame, **{name: 0.4}))
        assert abs(holes[:, :, :32].mean() - 0.4) < 0.02 and not holes[:, :, 32:].any()
    frame = plane(0.3, 32)
    frame.normals = np.zeros((32, SIZE, SIZE, 3), np.float32)
    frame.normals[..., 2] = -1  # every ray meets this plane at its own angle: at the centre of the image, at none
    assert lost(apply("grazing_holes", frame, grazing=1.0, angle=1.4)).mean() < 1e-3
    x, y = (np.arange(SIZE) - 31.5) / F, (np.arange(SIZE)[:, None] - 31.5) / F
    cos = 1 / np.sqrt(1 + x**2 + y**2)
    frame = plane(0.3, 32)
    share = lost(apply("grazing_holes", frame, grazing=0.8, angle=0.6)).mean(axis=0)
    expected = 0.8 / (1 + np.exp((cos - np.cos(0.6)) / 0.04))
    assert abs(share.mean() - expected.mean()) < 0.02
    assert abs(share[cos < 0.85].mean() - expected[cos < 0.85].mean()) < 0.04


def test_bias_is_what_its_formula_says():
    """A wrong scale, a lean in the normalised pixel, and a ripple that vanishes at whole disparities."""
    out = apply("depth_bias", plane(0.4), scale=0.01, tilt_x=0.003, tilt_y=-0.002).depth[0]
    x, y = (np.arange(SIZE) - 31.5) / F, (np.arange(SIZE)[:, None] - 31.5) / F
    np.testing.assert_allclose(out, 0.4 * 1.01 + 0.003 * x - 0.002 * y, atol=1e-6)
    for d, sign in ((40.0, 0.0), (40.25, 1.0), (40.5, 0.0), (40.75, -1.0)):
        z = FB / d
        error = apply("depth_bias", plane(z), ripple=0.06).depth.mean() - z
        assert abs(error - sign * 0.06 * z**2 / FB) < 2e-6


def test_a_wrong_baseline_is_one_factor_on_every_distance():
    """A sensor of true f and B that believes f' and B': z = f'B'/d, d = fB/z; nothing seen stays nothing."""
    frame = plane(0.3)
    frame.depth[0] = np.linspace(0.15, 3.0, SIZE * SIZE).reshape(SIZE, SIZE)
    frame.depth[0, :5, :7] = 0
    given = frame.depth[0].copy()
    out = apply("depth_scale", frame, factor=1.25).depth[0]
    seen = given > 0
    assert np.array_equal(out, given * np.float32(1.25)) and not out[~seen].any()
    believed = 430.0 * 0.0505
    wrong = np.where(seen, believed / (FB / np.where(seen, given.astype(float), 1)), 0)
    frame.depth[0] = given
    np.testing.assert_allclose(apply("depth_scale", frame, factor=believed / FB).depth[0], wrong, rtol=3e-7)


def test_noise_in_metres_has_a_floor_and_grows_with_the_squared_distance():
    """sigma(z) = sigma0 + k z^2, normal and unbiased in z, independent from pixel to pixel and frame to frame."""
    z = np.array([0.1, 0.3, 0.6, 1.0, 2.0])
    noise = [apply("depth_noise", plane(d, 8), sigma0=0.001, k=0.004).depth.astype(float) - np.float32(d) for d in z]
    np.testing.assert_allclose([n.std() for n in noise], 0.001 + 0.004 * z**2, rtol=0.02)
    for n in (noise[0], noise[-1]):
        x = n / n.std()
        assert abs(x.mean()) < 0.02 and abs(np.mean(x**3)) < 0.05 and abs(kurtosis(x, axis=None)) < 0.1
        assert abs(np.mean(x[:, :, 1:] * x[:, :, :-1])) < 0.02 and abs(np.mean(x[1:] * x[:-1])) < 0.02
    floor = apply("depth_noise", step(0.2, 0.8), sigma0=0.002).depth[0] - step(0.2, 0.8).depth[0]
    np.testing.assert_allclose([floor[:, 24:40].std(), floor[:, :24].std()], 0.002, rtol=0.1)
    near = apply("depth_noise", plane(0.02, 8), sigma0=0.02).depth  # behind the lens with the chance of -1 sigma
    assert near.min() == 0 and abs(np.mean(near == 0) - 0.1587) < 0.01


@pytest.mark.parametrize("share", [0.02, 0.1, 0.4])
@pytest.mark.parametrize("size", [0.0, 4.0, 8.0])
def test_dropout_loses_its_share_in_blobs_of_its_size(share, size):
    """The share, whatever the size; runs along rows and columns as long as stated; the next frame loses others."""
    given = plane(0.3, 40, 160)
    holes = lost(apply("depth_dropout", given, share=share, size=size))
    # of as many independent blobs as there are size^2 / share in the images
    assert abs(holes.mean() / share - 1) < 5 * max(size, 1) / np.sqrt(share * holes.size)
    assert np.array_equal(given.depth[~holes], np.full((~holes).sum(), 0.3, np.float32))
    for pixels in (holes, holes.swapaxes(1, 2)):
        starts = (pixels[:, :, 1:] & ~pixels[:, :, :-1]).mean()
        run = holes.mean() / starts
        expected = size if size else 1 / (1 - share)
        assert abs(run / expected - 1) < 0.12, run
    again = lost(apply("depth_dropout", plane(0.3, 40, 160), draw=1, share=share, size=size))
    assert abs((holes & again).mean() / share**2 - 1) < 0.1 + 5 * max(size, 1) / np.sqrt(share**2 * holes.size)


def test_what_was_lost_stays_lost():
    """No effect on depth invents a reading, or turns none into something that is not 0."""
    for name, values in {
        "disparity_noise": {"sd": 1.0},
        "depth_temporal": {"sd": 1.0},
        "depth_bias": {"scale": 0.05, "tilt_x": 0.05, "ripple": 0.3},
        "disparity_quantization": {"step": 0.5},
        "grazing_holes": {"blobs": 0.3, "grazing": 1.0},
        "edge_fattening": {"window": 9.0, "focal": F},
        "stereo_shadow": {"baseline": 0.05},
        "depth_scale": {"factor": 1.2},
        "depth_noise": {"sigma0": 0.02, "k": 0.1},
        "depth_dropout": {"share": 0.3},
    }.items():
        frame = step(0.2, 0.4)
        frame.depth[:, 10:20, 10:20] = 0
        assert lost(apply(name, frame, **values))[:, 10:20, 10:20].all(), name


@pytest.mark.parametrize("degrees", [-4.0, -2.4, 0.0, 2.4, 4.0])
def test_the_transition_to_grazing_is_as_wide_as_stated(degrees):
    """A surface turned so that all rays meet it `degrees` beyond 1.3 rad: 0.04 in the cosine, 2.4 degrees there, not 4.

    With a darkness and blobs beside it the chances of keeping a reading multiply.
    """
    frame, angle = plane(0.3, 64), 1.3
    x, y = (np.arange(SIZE) - 31.5) / F, (np.arange(SIZE)[:, None] - 31.5) / F
    ray = np.stack(np.broadcast_arrays(x, y, 1.0), -1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    across = np.cross(ray, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    a = angle + np.deg2rad(degrees)
    normals = np.sin(a) * across - np.cos(a) * ray
    frame.normals = np.broadcast_to(normals, (64, SIZE, SIZE, 3)).astype(np.float32)
    frame.rgb[:] = 0.1
    share = lost(apply("grazing_holes", frame, grazing=0.8, dark=0.5, blobs=0.1, angle=angle)).mean()
    grazing = 0.8 / (1 + np.exp(-degrees / np.rad2deg(0.04 / np.sin(angle))))  # of the incidence itself, to first order
    assert abs(np.rad2deg(0.04 / np.sin(angle)) - 2.4) < 0.05
    assert abs(share - (1 - (1 - grazing) * (1 - 0.5 * (1 - 0.1**2 / 0.05)) * (1 - 0.1))) < 0.015
