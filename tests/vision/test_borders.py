"""Predicted borders lie where the parts change, move as the projection says, and are found again in pictures."""

from __future__ import annotations

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.standard import standard_cameras
from vispeg.robots.scene import build
from vispeg.task.start import home
from vispeg.vision.borders import borders_of
from vispeg.vision.eye import Eye, camera_of, recorded_of
from vispeg.vision.predict import Predictor
from vispeg.vision.search import noise_of_picture, search
from vispeg.worlds.world import World

W, H = 160, 120


def sized(camera: Camera, fov: float) -> Camera:
    f = W / 2 / np.tan(np.radians(fov) / 2)
    return camera.moved(width=W, height=H, fx=f, fy=f, cx=(W - 1) / 2, cy=(H - 1) / 2)


@pytest.fixture(scope="module")
def cell():
    scene = build()
    wide, _, external = standard_cameras()
    with Predictor(scene, [sized(wide, 75.0), sized(external, 50.0)], backend="raycast") as predictor:
        yield predictor, home(scene)


def world(name, where, **params):
    return World(effects=(EffectInstance.of(name, where, **params),))


@pytest.mark.parametrize("camera", ["wrist_wide", "external"])
def test_parts_change_at_the_border(cell, camera):
    """1/50 px to either side of a point there are the two parts that it names; the normal is of unit length."""
    predictor, q = cell
    predictor.see(world("lens_distortion", camera, k1=-0.1, p1=0.002))
    borders = borders_of(predictor.draw(camera, q), predictor.geometry, step=1.5)
    assert len(borders) > 100
    assert np.allclose(np.linalg.norm(borders.normal, axis=1), 1)
    sides = [predictor.geometry.cast(camera, borders.pixel + k * 0.02 * borders.normal)[2] for k in (-1, 1)]
    assert np.mean(np.stack(sides, 1) == borders.parts) > 0.98
    assert np.abs(borders.moved(predictor.geometry, camera)).max() < 1e-6


MOVES = {
    "camera_offset": {"x": 0.002, "ry": 0.01},
    "focal_error": {"fx": 0.02, "fy": 0.02},
    "principal_point_error": {"x": 1.0, "y": -2.0},
    "lens_distortion": {"k1": -0.05, "p2": 0.003},
}


@pytest.mark.parametrize("camera", ["wrist_wide", "external"])
@pytest.mark.parametrize("effect", MOVES)
def test_moved_borders_are_the_borders_of_the_other_world(cell, camera, effect):
    """Points moved by the projection alone lie on the border that is predicted anew, to a second-order rest."""
    predictor, q = cell
    predictor.see(World())
    borders = borders_of(predictor.draw(camera, q), predictor.geometry)
    predictor.see(world(effect, camera, **MOVES[effect]))
    predictor.geometry.at(q)
    moved = borders.moved(predictor.geometry, camera)
    assert np.sqrt(np.mean(moved**2)) > 0.3
    there = borders.pixel + moved[:, None] * borders.normal
    clear = borders.free.min(axis=1) > 5
    sides = [predictor.geometry.cast(camera, there + k * 0.2 * borders.normal)[2] for k in (-1, 1)]
    assert np.mean((np.stack(sides, 1) == borders.parts)[clear]) > 0.93


def test_found_displacements_are_the_true_ones(cell):
    """In a picture of the moved camera, the search finds what the projection predicts, to a fifth of a pixel."""
    predictor, q = cell
    predictor.see(World())
    borders = borders_of(predictor.draw("wrist_wide", q), predictor.geometry)
    predictor.see(world("camera_offset", "wrist_wide", x=0.002))
    picture = predictor.draw("wrist_wide", q).rgb
    off = search(picture, borders).along - borders.moved(predictor.geometry, "wrist_wide")
    assert np.mean(np.isnan(off)) < 0.1
    assert abs(np.nanmedian(off)) < 0.2 and np.nanmedian(np.abs(off)) < 0.3
    before = search(picture, borders).along
    assert np.nanmedian(np.abs(before)) > 2 * np.nanmedian(np.abs(off))


def test_an_edge_of_a_surface_beside_its_border_is_not_taken_for_it():
    """From above, a table's side is a strip of 1.5 px between its top and the floor: the edge of the top is the
    stronger step. A peg's side bends all the way, and its border stays.
    """
    middle = ((W - 1) / 2, (H - 1) / 2)
    above = Camera("above", W, H, 140.0, 140.0, *middle, parent="base", pos=(1, 1, 1), quat=(0, 1, 0, 0))
    wide = sized(standard_cameras()[0], 75.0)
    with Predictor(build(), [above, wide], backend="raycast") as predictor:
        q = home(predictor.scene)
        predictor.see(World())
        picture = predictor.draw("above", q)
        off = search(picture.rgb, borders_of(picture, predictor.geometry, step=1.0), window=3.0).along
        assert np.isfinite(off).sum() > 5 and np.nanmax(np.abs(off)) < 0.75, "half a pixel: one ray a pixel"
        borders = borders_of(predictor.draw("wrist_wide", q), predictor.geometry)
        parts = [*predictor.scene.parts]
        assert sum(parts[near - 1] == "peg" for near, _ in borders.parts) > 5


def test_an_arms_error_is_no_cameras(cell):
    """A wrist camera carries the hand: an encoder's offset leaves the peg's border and moves the fixture's."""
    predictor, q = cell
    predictor.see(World())
    borders = borders_of(predictor.draw("wrist_wide", q), predictor.geometry)
    predictor.see(world("encoder_offset", "joint6", offset=0.01))
    predictor.geometry.at(q)
    moved = np.abs(borders.moved(predictor.geometry, "wrist_wide"))
    parts = [*predictor.scene.parts]
    near = np.array([parts[k - 1] for k in borders.parts[:, 0]])
    assert moved[near == "peg"].max() < 1e-9 and np.median(moved[near == "fixture"]) > 0.3


def test_a_step_is_found_where_it_is():
    """A synthetic edge at a known place, blurred and noisy: no bias, and an error as stated."""
    from scipy.special import erf

    from vispeg.effects.common.light import to_srgb
    from vispeg.vision.borders import Borders

    rng = np.random.default_rng(0)
    n, at = 60, 40.3
    column = 255 * to_srgb(0.25 + 0.18 * erf((np.arange(80) - at) / np.sqrt(2) / 0.6))  # a pixel holds a mean of light
    picture = np.repeat(np.tile(column, (3 * n, 1))[..., None], 3, 2) + rng.normal(scale=3.0, size=(3 * n, 80, 3))
    picture = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    assert noise_of_picture(picture) == pytest.approx(3.0, rel=0.15)
    pixel = np.stack([np.full(n, 38.0), np.arange(n) * 3.0 + 1], 1)
    zero, pair = np.zeros(n), np.ones((n, 2), int)
    borders = Borders(
        pixel, np.tile([1.0, 0.0], (n, 1)), pair, zero, pair[:, 0], np.zeros((n, 3)), np.full((n, 2), 12.0)
    )
    found = search(picture, borders)
    assert np.nanmean(found.along) == pytest.approx(at - 38, abs=0.03)
    assert np.nanstd(found.along) < 0.08
    assert np.isnan(search(np.full_like(picture, 90), borders).along).all()


def test_noise_alone_has_no_edges():
    """Steps of a flat, noisy picture stay under what the noise gives: four times their RMS are not reached."""
    from vispeg.vision.borders import Borders

    n, noise = 60, 12.0
    picture = 128 + np.random.default_rng(0).normal(scale=noise, size=(3 * n, 80, 3))
    picture = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    pixel, pair = np.stack([np.full(n, 38.0), np.arange(n) * 3.0 + 1], 1), np.ones((n, 2), int)
    borders = Borders(
        pixel, np.tile([1.0, 0.0], (n, 1)), pair, np.zeros(n), pair[:, 0], np.zeros((n, 3)), np.full((n, 2), 12.0)
    )
    found = search(picture, borders)
    assert np.isnan(found.along).all()
    assert found.strength.max() > RULES.edge_step, "the least step alone would have taken them for edges"


def test_cameras_are_recorded_as_they_are():
    for camera in standard_cameras():
        again = camera_of(recorded_of(camera))
        assert np.allclose(again.rotation, camera.rotation, atol=1e-12) and np.allclose(again.pos, camera.pos)
        assert again.parent == camera.parent and np.allclose(again.K, camera.K)
    assert camera_of(recorded_of(standard_cameras()[0])).moved(name="x").name == "x"
    assert RecordedCamera("a", 4, 4, 5.0, 5.0, 1.5, 1.5).pose is None


def test_an_eye_inverts_its_projection():
    wide = sized(standard_cameras()[0], 75.0)
    eye = Eye(wide.moved(fx=wide.fx * 1.02, cx=wide.cx + 2), wide, (-0.1, 0.01, 0.002, -0.001, 0.0))
    pixels = np.stack(np.meshgrid(np.arange(W), np.arange(H)), -1).astype(float)
    ideal = eye.ideal(pixels)
    again = eye.project(np.concatenate([ideal, np.ones((H, W, 1))], -1))
    assert np.nanmax(np.abs(again - pixels)) < 1e-6 and np.isfinite(ideal).mean() > 0.99
