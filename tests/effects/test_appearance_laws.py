"""Each look against what it says of itself: colour, geometry of lamps and things, patterns, panoramas, files."""

from __future__ import annotations

import colorsys
import struct

import cv2
import mujoco
import numpy as np
import pytest

from tests.effects.looks import SCENE, nominal, written
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.effects.appearance.distractors import KEEP_OUT, size_bounds
from vispeg.effects.common import images as _images
from vispeg.effects.common import panorama as _panorama
from vispeg.effects.common import texture as _texture
from vispeg.effects.common.colour import rgb_of_hsv, tint_of_blackbody, xyz_of_blackbody


def texture(model: mujoco.MjModel, name: str) -> np.ndarray:
    i = model.texture(name).id
    shape = model.tex_height[i], model.tex_width[i], model.tex_nchannel[i]
    return model.tex_data[model.tex_adr[i] :][: np.prod(shape)].reshape(shape)


# Colour ---------------------------------------------------------------------------------------------------------------
def test_hsv_equals_the_standard_library():
    hsv = stream(0, "hsv").uniform(0, 1, (200, 3))
    np.testing.assert_allclose(rgb_of_hsv(*hsv.T), [colorsys.hsv_to_rgb(*x) for x in hsv], atol=1e-12)


@pytest.mark.parametrize("kelvin", [2000.0, 3000.0, 3900.0, 5000.0, 6500.0, 12000.0])
def test_black_body_lies_on_the_planckian_locus(kelvin):
    """Chromaticity by integration agrees with the cubic splines of Kim et al., US patent 7024034 (2002)."""
    t = 1e3 / kelvin
    if kelvin < 4000:
        x = np.polyval([-0.2661239, -0.2343589, 0.8776956, 0.179910], t)
    else:
        x = np.polyval([-3.0258469, 2.1070379, 0.2226347, 0.240390], t)
    if kelvin < 2222:
        y = np.polyval([-1.1063814, -1.34811020, 2.18555832, -0.20219683], x)
    elif kelvin < 4000:
        y = np.polyval([-0.9549476, -1.37418593, 2.09137015, -0.16748867], x)
    else:
        y = np.polyval([3.0817580, -5.87338670, 3.75112997, -0.37001483], x)
    xyz = np.array(xyz_of_blackbody(kelvin))
    np.testing.assert_allclose(xyz[:2] / xyz.sum(), [x, y], atol=0.004)


def test_temperature_is_white_at_6500_and_bluer_the_hotter():
    assert tint_of_blackbody(6500.0).tolist() == [1, 1, 1]
    blue_over_red = [t[2] / t[0] for t in map(tint_of_blackbody, np.arange(2000.0, 12001, 500))]
    assert np.all(np.diff(blue_over_red) > 0)
    warm = tint_of_blackbody(3000.0)
    assert warm[0] == 1 and 0.4 < warm[2] < 0.65 < warm[1] < 1


def test_colour_reaches_its_part_in_the_stated_share():
    model = written([EffectInstance.of("part_colour", "peg", amount=0.25, hue=1 / 3, saturation=1, value=1)]).model
    plain, m = nominal().mat_rgba, model.material("peg").id
    np.testing.assert_allclose(model.mat_rgba[m, :3], 0.75 * plain[m, :3] + 0.25 * np.array([0, 1, 0]), atol=1e-6)
    assert model.mat_rgba[m, 3] == plain[m, 3]


# Patterns -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", sorted(_texture.KINDS))
def test_patterns_tile_without_a_seam(kind):
    """Across the edge, neighbours differ no more than neighbours inside do; all values from 0 to 1 in use."""
    for seed in range(5):
        image = _texture.KINDS[kind](stream(seed, kind))
        assert image.shape == (_texture.SIZE, _texture.SIZE) and image.min() >= 0 and image.max() <= 1
        assert np.ptp(image) > 0.9
        for axis in (0, 1):
            step = np.abs(np.diff(image, axis=axis)).mean(axis=1 - axis)
            seam = np.abs(image.take(0, axis) - image.take(-1, axis)).mean()
            assert seam <= 1.1 * step.max() + 1e-6, (seed, axis)


def test_perlin_equals_a_sum_over_corners_pixel_by_pixel():
    rows, columns = 4, 8
    angle = stream(3, "p").uniform(0, 2 * np.pi, (rows, columns))
    fast = _texture._octave(stream(3, "p"), rows, columns)
    for py, px in [(0, 0), (5, 77), (31, 32), (127, 127), (64, 3)]:
        y, x = (py + 0.5) / 128 * rows, (px + 0.5) / 128 * columns
        slow = 0.0
        for j in (int(y), int(y) + 1):
            for i in (int(x), int(x) + 1):
                fade = np.prod([1 - (6 * t**5 - 15 * t**4 + 10 * t**3) for t in (abs(y - j), abs(x - i))])
                a = angle[j % rows, i % columns]
                slow += fade * (np.cos(a) * (x - i) + np.sin(a) * (y - j))
        # the slope's first component goes with rows in the code: sin with y, cos with x
        assert fast[py, px] == pytest.approx(slow, abs=1e-6)


def test_pattern_has_features_of_the_stated_size():
    """A checkerboard of 30 mm squares, eight to a tile: the tile is 0.24 m wide, in texrepeat's repeats per metre."""
    kind = list(_texture.KINDS).index("checkerboard")
    model = written([EffectInstance.of("part_texture", "table", amount=1.0, kind=kind, scale=0.03)]).model
    m = model.material("table").id
    np.testing.assert_allclose(model.mat_texrepeat[m], 1 / 0.24, rtol=1e-6)
    tones = np.unique(texture(model, "table").reshape(-1, 3), axis=0)
    assert len(tones) == 2 and tones[1].tolist() == [255, 255, 255]
    assert texture(model, "wall").min() == 255


# Lamps ----------------------------------------------------------------------------------------------------------------
def test_a_moved_lamp_points_at_the_same_spot():
    model = written([EffectInstance.of("light_position", "key", x=0.7, y=-0.4, z=0.3)]).model
    i = model.light("key").id
    np.testing.assert_allclose(model.light_pos[i] - nominal().light_pos[i], [0.7, -0.4, 0.3])

    def spot(m):
        return m.light_pos[i] - m.light_dir[i] * m.light_pos[i, 2] / m.light_dir[i, 2]

    np.testing.assert_allclose(spot(model), spot(nominal()), atol=1e-9)


def test_a_turned_lamp_turns_by_the_stated_angle():
    model = written([EffectInstance.of("light_direction", "back", y=0.3)]).model
    i = model.light("back").id
    a, b = nominal().light_dir[i], model.light_dir[i]  # the lamp's axis lies in the x-z plane
    assert np.arccos(a @ b) == pytest.approx(0.3, abs=1e-9) and b[1] == 0
    assert np.cross(a, b)[1] > 0


@pytest.mark.parametrize(("extra", "lit"), [(-3, 1), (-1, 1), (0.4, 2), (1, 3), (2, 4), (3, 4)])
def test_lamps_are_counted(extra, lit):
    model = written([EffectInstance.of("light_count", "scene", extra=extra)]).model
    assert model.light_active.sum() == lit
    assert list(model.light_active) == sorted(model.light_active, reverse=True)


# Distractors ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("seed", range(12))
def test_things_lie_on_the_table_clear_of_the_hole_and_of_each_other(seed):
    model = written([EffectInstance.of("distractors", "scene", count=5, seed=seed, size=1.5)]).model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hole = data.site("hole").xpos[:2]
    seen = [g for g in (model.geom(n).id for n in SCENE.parts["distractors"]) if model.geom_rgba[g, 3] == 1]
    assert len(seen) == 5
    circles = []
    for g in seen:
        turn = data.geom_xmat[g].reshape(3, 3)
        half = np.abs(turn) @ size_bounds(model.geom_type[g], model.geom_size[g])
        if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_ELLIPSOID:  # its box, turned about z only
            half[2] = model.geom_size[g, 2]
        assert data.geom_xpos[g, 2] == pytest.approx(half[2], abs=1e-9), "it rests on the table"
        assert half[2] <= 0.03 + 1e-9 and not model.geom_contype[g] and not model.geom_conaffinity[g]
        along = size_bounds(model.geom_type[g], model.geom_size[g])
        corners = along * np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
        circles.append((data.geom_xpos[g, :2], np.linalg.norm((corners @ turn.T)[:, :2], axis=1).max()))
        assert np.linalg.norm(data.geom_xpos[g, :2] - hole) > KEEP_OUT
        hit = np.zeros(1, np.int32)
        above = data.geom_xpos[g] + [0, 0, 1.0]
        far = mujoco.mj_ray(
            model, data, above, np.array([0, 0, -1.0]), np.array([1, 0, 0, 0, 0, 0], np.uint8), 1, -1, hit
        )
        assert hit[0] == g and far == pytest.approx(1 - half[2], abs=1e-6), "rays see it where it is"
    for k, (place, reach) in enumerate(circles):
        for other, further in circles[:k]:
            assert np.linalg.norm(place - other) >= max(reach, further)


def test_things_do_not_move_the_arm():
    """Seen and not touched: mass, contacts and forces are those of the empty table."""
    model = written([EffectInstance.of("distractors", "scene", count=5)]).model
    a, b = mujoco.MjData(model), mujoco.MjData(nominal())
    for _ in range(50):
        mujoco.mj_step(model, a)
        mujoco.mj_step(nominal(), b)
    np.testing.assert_array_equal(a.qpos, b.qpos)
    np.testing.assert_array_equal(a.qfrc_bias, b.qfrc_bias)


# Surroundings ---------------------------------------------------------------------------------------------------------
def test_a_sun_in_a_panorama_shines_from_where_it_was_put(tmp_path, monkeypatch):
    """Written to a Radiance file, turned about the vertical, and found again in the skybox."""
    elevation, azimuth, turn = 0.5, 0.8, 1.1
    image = np.full((128, 256, 3), 0.2, np.float32)
    i, j = int((np.pi / 2 - elevation) / np.pi * 128), int((0.5 - azimuth / (2 * np.pi)) * 256)
    image[i - 1 : i + 2, j - 1 : j + 2] = 500.0
    cv2.imwrite(str(tmp_path / "sun.hdr"), image)
    monkeypatch.setenv(_images.FOLDER, str(tmp_path))
    model = written([EffectInstance.of("environment", "scene", amount=1.0, turn=turn)]).model
    sky = texture(model, "sky")
    brightest = sky.reshape(-1, 3).astype(int).sum(axis=1)
    found = _panorama.directions(64).reshape(-1, 3)[brightest > 0.95 * brightest.max()].mean(axis=0)
    a = azimuth + turn
    true = [np.cos(elevation) * np.cos(a), np.cos(elevation) * np.sin(a), np.sin(elevation)]
    assert np.degrees(np.arccos(found @ true / np.linalg.norm(found))) < 2.0


def test_skybox_directions_cover_the_sphere():
    """Six faces of unit vectors; weighted by their solid angle they sum to 4 pi and to no direction."""
    d = _panorama.directions(64)
    t = (np.arange(64) + 0.5) / 32 - 1
    angle = (1 + t[:, None] ** 2 + t[None, :] ** 2) ** -1.5 / 32**2
    weight = np.tile(angle, (6, 1))
    assert weight.sum() == pytest.approx(4 * np.pi, rel=1e-3)
    np.testing.assert_allclose((weight[..., None] * d).sum(axis=(0, 1)), 0, atol=1e-9)
    np.testing.assert_allclose(np.einsum("ijk,ijl,ij->kl", d, d, weight), np.eye(3) * 4 * np.pi / 3, atol=5e-3)


def test_tone_mapping_takes_any_light_in_order():
    grey = np.geomspace(1e-4, 1e5, 50)[:, None] * np.ones(3)
    image = _panorama.tone_mapped(grey)[:, 0]
    assert np.all(np.diff(image) >= 0) and 0 <= image[0] < 0.01 and 0.99 < image[-1] <= 1
    uniform = _panorama.tone_mapped(np.full((4, 4, 3), 37.0))  # L / (1 + L) of 18 % grey, encoded
    np.testing.assert_allclose(uniform, 1.055 * (0.18 / 1.18) ** (1 / 2.4) - 0.055, atol=1e-5)


def test_a_level_surface_under_one_sky_receives_that_sky():
    dome = np.ones((64, 128, 3), np.float32) * [0.2, 0.4, 0.8]
    dome[32:] = 50.0  # what lies below the horizon does not reach it
    from vispeg.effects.appearance.environment import received

    np.testing.assert_allclose(received(dome), [0.2, 0.4, 0.8], rtol=1e-6)


# Files ----------------------------------------------------------------------------------------------------------------
def test_a_users_image_is_what_the_part_shows(tmp_path, monkeypatch):
    pixels = stream(0, "image").integers(0, 256, (128, 128, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "b.png"), pixels[..., ::-1])
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 4, 3), np.uint8))
    monkeypatch.setenv(_images.FOLDER, str(tmp_path))
    model = written([EffectInstance.of("image_texture", "table", amount=1.0, pick=0.9, size=0.5)]).model
    np.testing.assert_array_equal(texture(model, "table"), pixels)
    assert model.mat_rgba[model.material("table").id].tolist() == [1, 1, 1, 1]
    turned = written([EffectInstance.of("image_texture", "table", amount=1.0, pick=0.9, turns=1.5)]).model
    np.testing.assert_array_equal(texture(turned, "table"), np.rot90(pixels))
    cv2.imwrite(str(tmp_path / "b.png"), 255 - pixels[..., ::-1])
    model = written([EffectInstance.of("image_texture", "table", amount=1.0, pick=0.9, size=0.5)]).model
    np.testing.assert_array_equal(texture(model, "table"), 255 - pixels, "the image that is there now")


def test_what_ships_can_be_read():
    for path in _images.images(_images.PICTURES):
        assert np.ptp(_images.picture(path, 64)) > 0.2
    for path in _images.images(_images.ENVIRONMENTS):
        assert _images.environment(path).shape == (128, 256, 3)


def test_panoramas_for_training_are_none_of_those_for_judging(tmp_path, monkeypatch):
    """20 that ship and differ from each other; of a user's folder those below `training/`, all where it has no such."""
    training, judging = (_images.images(_images.ENVIRONMENTS, t) for t in (True, False))
    assert len(training) == 20 and len(judging) == 4 and not set(training) & set(judging)
    colours = np.array([_images.environment(p).mean(axis=(0, 1)) for p in training])
    assert np.abs(colours[:, None] - colours).max(-1)[~np.eye(20, dtype=bool)].min() > 0.01
    monkeypatch.setenv(_images.FOLDER, str(tmp_path))
    (tmp_path / "a.hdr").write_bytes(judging[0].read_bytes())
    assert len(_images.images(_images.ENVIRONMENTS, True)) == 1, "there are no others"
    (tmp_path / "training").mkdir()
    (tmp_path / "training" / "b.hdr").write_bytes(training[0].read_bytes())
    assert [p.name for p in _images.images(_images.ENVIRONMENTS, True)] == ["b.hdr"]
    assert [p.name for p in _images.images(_images.ENVIRONMENTS)] == ["a.hdr"]


def test_a_training_world_cycles_through_its_panoramas():
    from vispeg.task.world_file import load_world

    world, scene = load_world("S-environments").world, SCENE
    drawn = [e for k in range(120) for e in world.sample(k, scene).effects if e.effect == "environment"]
    assert len(drawn) == 120 and all(e.params["pick"].value > 1 for e in drawn)
    picks = {int(20 * (e.params["pick"].value - 1)) for e in drawn}
    assert len(picks) == 20
    one, other = (
        written([EffectInstance.of("environment", "scene", amount=1.0, pick=t)]).model.tex_data.copy()
        for t in (0.3, 1.3)
    )
    assert not np.array_equal(one, other)


@pytest.mark.parametrize(("name", "metres", "degrees"), [("article", 0.1, 10), ("article-narrow", 0.03, 5)])
def test_the_articles_camera_is_drawn_from_its_ranges(name, metres, degrees):
    """One offset of each camera, from end to end as stated."""
    from vispeg.task.world_file import load_world

    (r,) = [r for r in load_world(name).world.ranges if r.effect == "camera_offset"]
    for axis in ("x", "y", "z", "rx", "ry", "rz"):
        end = metres if len(axis) == 1 else np.radians(degrees)
        np.testing.assert_allclose([r.params[axis].at(0.0), r.params[axis].at(1.0)], [-end, end], rtol=1e-4)


def png_of(width: int, height: int) -> bytes:
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", width, height) + bytes(40)


@pytest.mark.parametrize(
    ("effect", "file", "content", "words"),
    [
        ("image_texture", "a.png", b"no image at all", "is not an image"),
        ("image_texture", "a.png", png_of(64, 64), "cannot be read"),
        ("image_texture", "a.png", png_of(100_000, 100_000), "too large"),
        ("image_texture", "a.jpg", b"\xff\xd8\xff\xe0", "cannot be read"),
        ("image_texture", "notes.txt", b"", "no image in the folder"),
        ("environment", "a.hdr", png_of(64, 64), "is not a Radiance HDR"),
        ("environment", "a.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 90000 +X 90000\n", "too large"),
        ("environment", "a.hdr", b"#?RADIANCE\n\n", "without a resolution"),
        ("environment", "a.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n", "cannot be read"),
        ("environment", "a.png", b"", "no image in the folder"),
    ],
)
def test_a_file_that_is_no_such_image_is_named(tmp_path, monkeypatch, effect, file, content, words):
    (tmp_path / file).write_bytes(content)
    monkeypatch.setenv(_images.FOLDER, str(tmp_path))
    with pytest.raises(UserError, match=words) as error:
        written([EffectInstance.of(effect, "all", amount=1.0)])
    assert str(tmp_path) in str(error.value)


def test_a_folder_that_is_none_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv(_images.FOLDER, str(tmp_path / "gone"))
    with pytest.raises(UserError, match="does not name a folder"):
        written([EffectInstance.of("image_texture", "table", amount=1.0)])
