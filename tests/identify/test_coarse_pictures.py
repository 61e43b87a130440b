"""Cameras far from where they were believed, and late ones, come near enough for their borders to be sought."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from border_points import CELL, WRIST, points_at, seen
from scipy.interpolate import CubicSpline

from vispeg.api.recording.look import cameras_of, look_of, scene_of
from vispeg.core.effect import EffectInstance
from vispeg.identify.fit import fit_job
from vispeg.identify.motions.look_motion import look_motion
from vispeg.identify.pictures.build import border_evidence
from vispeg.identify.pictures.coarse import REACHES, WAYS, Outline, _fields, _way, brought_near
from vispeg.identify.pictures.sight import Sight
from vispeg.identify.pool import run_together
from vispeg.task.start import home
from vispeg.vision.photograph import photograph
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World


def test_a_field_holds_the_distance_to_the_nearest_edge_of_its_direction():
    picture = np.zeros((80, 120, 1), np.float32)
    picture[:, 60:] = 1.0  # one edge, whose normal points across
    fields = _fields(picture, 0.05)
    across = _way(np.array([[1.0, 0.0], [-1.0, 0.0]]))
    assert across[0] == across[1]
    away = np.abs(np.arange(120) - 59.5)
    inside = slice(20, 60)
    assert fields.shape == (WAYS, 80, 120)
    assert np.abs(fields[across[0], inside] - np.minimum(away, REACHES[0])).max() < 2.0  # an edge is some px wide
    down = fields[_way(np.array([[0.0, 1.0]]))[0]]
    assert np.all(down == REACHES[0])


def test_points_outside_the_picture_are_as_far_as_can_be():
    geometry, sight = seen((40, 30))
    at = np.array([[10.5, 20.0], [-5.0, 3.0], [39.0, 29.0]])
    fields = np.tile(np.arange(40, dtype=np.float32), (1, WAYS, 30, 1))
    outline = Outline(sight, points_at(geometry, at, np.tile([1.0, 0.0], (3, 1))), fields)
    assert outline.distances(geometry, World(), 40.0) == pytest.approx([10.5, 40.0, 39.0], abs=2e-3)
    assert outline.distances(geometry, World(), 5.0) == pytest.approx([5.0, 5.0, 5.0])


def test_a_camera_that_sees_no_border_stays_where_it_is():
    scene = scene_of(CELL)
    (wrist,) = cameras_of([WRIST], scene, (40, 30))
    up = replace(wrist, parent="base", pos=(0.0, 0.0, 5.0), quat=(1.0, 0.0, 0.0, 0.0))  # looks at the sky
    sky = np.random.default_rng(0).integers(0, 255, (30, 40, 3), np.uint8)
    times, posture = np.linspace(0.0, 1.0, 3), home(scene)
    sight = Sight("sky", up, times, lambda t, _: np.tile(posture, (len(t), 1)), lambda i: sky, lambda i: None)
    world = World().add(EffectInstance.of("camera_offset", WRIST), EffectInstance.of("camera_delay", WRIST))
    with Predictor(scene, [up]) as predictor:
        assert brought_near(predictor, [sight], world) == [world, world]


@pytest.mark.slow
@pytest.mark.parametrize(
    "hidden",
    [{"x": 0.02, "ry": 0.05}, {"x": 0.08, "ry": np.radians(8)}, {"x": -0.08, "y": 0.03, "rx": np.radians(8)}],
)
def test_a_camera_that_is_far_off_is_brought_to_where_it_is(hidden):
    scene = scene_of(CELL)
    cameras = cameras_of([WRIST], scene, (320, 240))
    motion = look_motion("look", scene, 100.0, 16.0)
    curve = CubicSpline(motion.time, motion.q_cmd)
    stamps = np.linspace(1.0, 15.0, 8)
    world = CELL.add(EffectInstance.of("camera_offset", WRIST, **hidden), *look_of("S/3", scene))
    shots = photograph(replace(scene), cameras, world, curve, stamps, 3, finer=1)
    sight = Sight("far", cameras[0], stamps, lambda t, _: curve(t), lambda i: shots[i].rgb, lambda i: shots[i].depth)
    evidence, _ = border_evidence(scene, [sight], [sight], CELL)
    (near,) = [e for e in evidence.settled.effects if e.effect == "camera_offset"]
    (fit,) = run_together([fit_job(evidence, CELL.add(near), [0])], evidence.residuals)
    (found,) = fit.world.effects
    for name, v in found.params.items():
        assert abs(v.value - hidden.get(name, 0.0)) < (5e-4 if name in "xyz" else np.radians(0.1))
