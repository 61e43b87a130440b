"""Figures of depth and light: zero for the true sensor, moved by every effect of it, and right in closed form."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from sensor_shots import CELL, LIT, WRIST, measured, shots

from vispeg.api.recording.look import cameras_of, scene_of
from vispeg.core.effect import REGISTRY, EffectInstance, effect
from vispeg.identify.channels import shows
from vispeg.identify.motions.look_motion import look_motion
from vispeg.identify.pictures.depth_figures import ERROR, DepthFigures, table
from vispeg.identify.pictures.sensor import sensor_evidence
from vispeg.identify.pictures.shots import Shot, shots_of
from vispeg.identify.pictures.sight import Sight
from vispeg.vision.photograph import photograph
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World

KINDS = {name: "depth" for name, kind in REGISTRY.items() if shows(kind, "depth")} | {
    name: "light" for name, kind in REGISTRY.items() if shows(kind, "light")
}


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


def in_metres(off: dict[str, float]) -> list[tuple[float, float]]:
    """Far end of each range of distance, and by how much depth is off there, m."""
    some = {f.name: f.ordinary for f in table()}
    ends = [(float(k.split(" to ")[1].split()[0]), v * some[k]) for k, v in off.items() if k.startswith(ERROR)]
    return sorted(ends)


def test_figures_of_depth_are_the_error_that_was_hidden():
    off = measured("depth", EffectInstance.of("depth_scale", WRIST, factor=1.013)).off(LIT)
    bins = in_metres(off)
    assert len(bins) > 2 and np.array([error / far for far, error in bins]) == pytest.approx(0.013, rel=0.35)
    off = measured("depth", EffectInstance.of("depth_bias", WRIST, offset=0.005)).off(LIT)
    assert np.array([error for _, error in in_metres(off)]) == pytest.approx(0.005, abs=2e-5)
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


def fast_shots(*effects: EffectInstance) -> tuple[Sight, list[Shot]]:
    """Frames of a camera in fast motion, by a world with these effects; no posture is off."""
    scene = scene_of(CELL)
    (camera,) = cameras_of([WRIST], scene, (320, 240))
    motion = look_motion("look-fast", scene, 100.0, 16.0)
    curve, stamps = CubicSpline(motion.time, motion.q_cmd), np.array([4.0, 6.5, 8.0, 9.5, 11.0])
    taken = photograph(scene, [camera], CELL.add(*effects), curve, stamps, 1)
    sight = Sight("x", camera, stamps, lambda t, i: curve(t), lambda i: taken[i].rgb, lambda i: None)
    with Predictor(scene, [camera], finer=3) as predictor:
        return sight, shots_of(predictor, sight, CELL, np.zeros((len(stamps), len(scene.joints))))


@pytest.mark.slow
def test_a_border_is_smeared_by_its_own_speed_and_one_at_rest_is_not():
    seconds = 0.02
    blurred = EffectInstance.of("motion_blur", WRIST, length=0.0, exposure=seconds)
    sight, some = fast_shots(blurred)
    evidence = sensor_evidence(scene_of(CELL), [(sight, some)], "light", LIT)
    assert evidence is not None
    (item,) = evidence.items
    smear = [f.name for f in item.figures.table].index("smear")
    assert np.nanmedian(item.figures.measured[:, smear]) == pytest.approx((1e3 * seconds) ** 2 / 12, rel=0.25)
    assert abs(evidence.off(LIT)["smear"]) > 1.3 and abs(evidence.off(LIT.add(blurred))["smear"]) < 0.5
    at_rest = np.abs(some[0].flow) < 5  # px/s: the gripper's own borders
    assert at_rest.sum() > 100


def test_the_shutter_of_another_camera_smears_nothing():
    own, other = (EffectInstance.of("motion_blur", name, length=0.0, exposure=0.02) for name in (WRIST, "scene"))
    figures = measured("light").items[0].figures
    plain, beside, open_ = (figures.modelled(LIT.add(*some)) for some in ((), (other,), (own,)))
    assert np.array_equal(plain, beside, equal_nan=True)
    assert not np.array_equal(plain, open_, equal_nan=True)
    assert np.array_equal(figures.modelled(LIT.add(own, other)), open_, equal_nan=True)


def test_a_hand_whose_borders_are_softer_than_the_room_s_is_no_open_shutter():
    """The camera carries its hand: all that tells its borders from the room's is not their speed alone."""
    sight, some = fast_shots()

    def soft_hand(shot: Shot) -> Shot:
        assert shot.rgb is not None
        near = cv2.dilate((~shot.fixed & (shot.rendering.parts > 0)).astype(np.uint8), np.ones((7, 7))) > 0
        return replace(shot, rgb=np.where(near[..., None], cv2.GaussianBlur(shot.rgb, (0, 0), 0.8), shot.rgb))

    evidence = sensor_evidence(scene_of(CELL), [(sight, [soft_hand(shot) for shot in some])], "light", LIT)
    assert evidence is not None and abs(evidence.off(LIT)["smear"]) < 0.5


@pytest.mark.parametrize("held", [True, False])
def test_scatter_of_a_matcher_whose_pixels_share_a_window_is_that_of_one_reading(held):
    """Neighbours differ by a quarter of it; one pixel at two times, and pixels that share no window, do not."""
    kind, values = "disparity_noise", {"sd": 0.3, "length": 1.5, "focal": 447.0, "baseline": 0.018}
    noisy = CELL.add(EffectInstance.of(kind, WRIST, **values))
    _, some = shots()
    out = []
    for shot in some:
        first, second = (shot.sensed(noisy, lambda k: True, draw=d)[1] for d in (0, 1))
        out.append(replace(shot, depth=first, again=second if held else None))
    figures = DepthFigures(out, (0.0, 1e-6))
    names = [f.name for f in figures.table]
    for k, near, far in ((names.index("scatter at 0.18 to 0.25 m"), 0.18, 0.25),):
        sigma = np.exp(np.nanmedian(figures.measured[:, k]))
        low, high = (0.3 / (447.0 * 0.018) * z**2 for z in (near, far))
        assert 0.9 * low < sigma < 1.1 * high
