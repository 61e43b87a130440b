"""Projection differences against closed form, and the words that say which effects' pictures are alike."""

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.pictures.projection import DISTANCES, projections
from vispeg.render.cameras.standard import standard_cameras
from vispeg.report.text.camera_words import confounded
from vispeg.report.text.camera_words import projections as sentences
from vispeg.robots.scene import build
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

WRIST = standard_cameras()[0]
MORE = 0.01  # of the focal length


def shifts(one: World, other: World) -> dict[float, np.ndarray]:
    geometry = Geometry(build(), [WRIST])
    return {p.distance: p for p in projections(geometry, one, other, None)}


def test_a_longer_focal_length_and_a_nearer_camera_are_one_picture_at_one_distance_only():
    """A point at distance d is magnified by d / (d - z) where the camera is nearer by z."""
    middle = DISTANCES[1]
    near = middle * MORE / (1 + MORE)
    longer = World(effects=(EffectInstance.of("focal_error", WRIST.name, fx=MORE, fy=MORE),))
    nearer = World(effects=(EffectInstance.of("camera_offset", WRIST.name, z=near),))
    plain, between = shifts(World(), longer), shifts(longer, nearer)
    for d, shift in plain.items():
        from_axis = shift.pixels - (WRIST.cx, WRIST.cy)
        assert np.allclose(shift.shift, MORE * from_axis, atol=1e-6), d
        # the point that `longer` sees there lies at from_axis / (1 + MORE) of the picture as calibrated
        apart = from_axis * (d / (d - near) / (1 + MORE) - 1)
        assert np.allclose(between[d].shift, apart, atol=1e-4), d
    assert between[middle].size < 1e-4 < 0.1 < between[DISTANCES[0]].size


def test_confounded_effects_are_stated_in_pixels_with_the_motion_that_separates_them():
    maps = [
        {"camera": "w", "distance_m": 0.15, "rms_px": 0.512, "uncertainty_px": 0.04},
        {"camera": "w", "distance_m": 0.5, "rms_px": 2.0, "uncertainty_px": 0.06},
    ]
    pair = {"effect": "focal_error(w)", "rival": "camera_offset(w)", "views_px": 0.031, "motion": "an approach"}
    assert confounded({"confounded": [{**pair, "projection": maps}]}) == [
        "focal_error(w) and camera_offset(w): 0.03 px apart in these views; over the image 0.51 px at 0.15 m, "
        "2.00 px at 0.5 m. To tell them: an approach"
    ]
    assert "over the image" not in confounded({"confounded": [{**pair, "projection": []}]})[0]
    assert sentences({"projection": maps}) == [
        "w: the picture is shifted by 0.51 px at 0.15 m, 2.00 px at 0.5 m (RMS over the image, 1 sigma 0.06 px)"
    ]
    assert sentences({"projection": [{**row, "rms_px": 0.0} for row in maps]}) == []
    assert sentences({}) == confounded({}) == []
