"""Figures of depth and light: zero for the true sensor, moved by every effect of it, and right in closed form."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from vispeg.api.recording.look import cameras_of, scene_of
from vispeg.core.effect import REGISTRY, EffectInstance, effect
from vispeg.identify.channels import shows
from vispeg.identify.motions.look_motion import look_motion
from vispeg.identify.pictures.sensor import SensorEvidence, sensor_evidence
from vispeg.identify.pictures.shots import Shot, shots_of
from vispeg.identify.pictures.sight import Sight
from vispeg.recordings.cell import CellBelief
from vispeg.vision.photograph import photograph
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World

CELL = World("iiwa14", "meg50+peg16", cell=CellBelief("nominal"))
WRIST, FRAMES = "wrist_wide", 6
KINDS = {name: "depth" for name, kind in REGISTRY.items() if shows(kind, "depth")} | {
    name: "light" for name, kind in REGISTRY.items() if shows(kind, "light")
}
LIT = World(effects=(EffectInstance.of("light_intensity", "all"),))  # the look is the predictor's own


@lru_cache
def shots() -> tuple[Sight, list[Shot]]:
    """Predicted frames along the look-about motion, with nothing measured."""
    scene = scene_of(CELL)
    (camera,) = cameras_of([WRIST], scene, (160, 120))
    motion = look_motion("look", scene, 100.0, 16.0)
    curve = CubicSpline(motion.time, motion.q_cmd)
    sight = Sight("x", camera, np.linspace(1, 15, FRAMES), lambda t, i: curve(t), lambda i: None, lambda i: None)
    with Predictor(scene, [camera], finer=3) as predictor:
        return sight, shots_of(predictor, sight, CELL, np.zeros((FRAMES, len(scene.joints))))


def measured(kind: str, *effects: EffectInstance, model: World = LIT) -> SensorEvidence:
    """Evidence of frames that passed through a sensor with these effects."""
    sight, some = shots()
    world = CELL.add(*effects)
    out = []
    for shot in some:
        rgb, depth = shot.sensed(world, lambda k: True)
        out.append(replace(shot, rgb=rgb, depth=depth))
    evidence = sensor_evidence(scene_of(CELL), [(sight, out)], kind, model)  # type: ignore[arg-type]
    assert evidence is not None
    return evidence


def typical(name: str) -> EffectInstance:
    """An effect on a picture that is drawn already: what a moving camera smears is not in it, see below."""
    sizes = {k: p.start for k, p in effect(name).params.items()}
    return EffectInstance.of(
        name, WRIST, **(sizes | ({"length": 3.0, "exposure": 0.0} if name == "motion_blur" else {}))
    )


@pytest.mark.parametrize("name", sorted(KINDS))
def test_every_effect_of_a_sensor_moves_a_figure_and_its_own_world_leaves_none(name):
    evidence = measured(KINDS[name], typical(name))
    true = LIT.add(typical(name))
    before, after = evidence.off(LIT), evidence.off(true)
    assert max(map(abs, before.values())) > 0.8
    # noise is compared on the smoothed picture, which is not free of it
    assert max(map(abs, after.values())) < (0.3 if name == "rgb_noise" else 0.05)


def test_a_sensor_without_errors_has_no_odd_figure():
    for kind in ("depth", "light"):
        assert max(map(abs, measured(kind).off(LIT).values())) < 0.01  # the smoothed picture has a little less grain


def test_figures_of_depth_are_the_error_that_was_hidden():
    off = measured("depth", EffectInstance.of("depth_scale", WRIST, factor=1.013)).off(LIT)
    bins = [v for k, v in off.items() if k.startswith("error, bin")]
    assert bins and np.allclose(np.array(bins) * 4e-3, 0.013, atol=2e-4)
    off = measured("depth", EffectInstance.of("depth_bias", WRIST, scale=0, tilt_x=0.003, tilt_y=-0.002, ripple=0)).off(
        LIT
    )
    assert np.allclose([off["lean across"] * 1e-3, off["lean down"] * 1e-3], [0.003, -0.002], atol=2e-4)


def test_exposure_is_told_in_a_stated_look_and_not_in_an_unknown_one():
    hidden = EffectInstance.of("exposure", WRIST, stops=-0.8)
    assert measured("light", hidden).off(LIT)["light"] * 0.3 == pytest.approx(-0.8, abs=0.1)
    assert "light" not in measured("light", hidden, model=World()).off(World())


def test_fall_off_is_read_from_places_seen_twice_whatever_their_colour():
    hidden = EffectInstance.of("vignetting", WRIST, amount=0.8)
    evidence = measured("light", hidden)
    (item,) = evidence.items
    figure = [f.name for f in item.figures.table].index("fall-off")
    slope = np.nanmedian(item.figures.measured[:, figure]) - np.nanmedian(item.figures.modelled(LIT)[:, figure])
    assert -2.2 < slope < -0.9  # log2(1 - 0.8 f): between -0.8 / ln 2 at the middle and twice as much at f = 0.6


def test_a_border_is_smeared_by_its_own_speed_and_one_at_rest_is_not():
    scene, seconds = scene_of(CELL), 0.02
    (camera,) = cameras_of([WRIST], scene, (320, 240))
    motion = look_motion("look-fast", scene, 100.0, 16.0)
    curve, stamps = CubicSpline(motion.time, motion.q_cmd), np.array([4.0, 6.5, 8.0, 9.5, 11.0])
    blurred = EffectInstance.of("motion_blur", WRIST, length=0.0, exposure=seconds)
    taken = photograph(scene, [camera], CELL.add(blurred), curve, stamps, 1)
    sight = Sight("x", camera, stamps, lambda t, i: curve(t), lambda i: taken[i].rgb, lambda i: None)
    with Predictor(scene, [camera], finer=3) as predictor:
        some = shots_of(predictor, sight, CELL, np.zeros((len(stamps), len(scene.joints))))
    evidence = sensor_evidence(scene, [(sight, some)], "light", LIT)
    assert evidence is not None
    (item,) = evidence.items
    smear = [f.name for f in item.figures.table].index("smear")
    assert np.nanmedian(item.figures.measured[:, smear]) == pytest.approx((1e3 * seconds) ** 2 / 12, rel=0.25)
    assert abs(evidence.off(LIT)["smear"]) > 1.3 and abs(evidence.off(LIT.add(blurred))["smear"]) < 0.5
    at_rest = np.abs(some[0].flow) < 5  # px/s: the gripper's own borders
    assert at_rest.sum() > 100
