"""What moves a picture is named from pictures in a look that the predictor does not know."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.interpolate import CubicSpline

from vispeg.api.fit import fit
from vispeg.api.recording.look import cameras_of, look_of, scene_of
from vispeg.channels.channel import CHANNELS, How
from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.diagnosis.pictures.coverage import excitations
from vispeg.diagnosis.pictures.excited import not_excited
from vispeg.diagnosis.pictures.halves import Halves
from vispeg.diagnosis.pictures.remainder import Left
from vispeg.diagnosis.pictures.run import _joints_said
from vispeg.diagnosis.pictures.spread import of_form, widened
from vispeg.diagnosis.pictures.verdict import decide
from vispeg.identify.fit import Fit
from vispeg.identify.motions.look_motion import look_motion
from vispeg.identify.pictures.scatter import robots
from vispeg.identify.space import Space
from vispeg.identify.whitener import Whitener
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.recording import Control, Recording
from vispeg.vision.photograph import photograph
from vispeg.worlds.world import World

CELL = World("iiwa14", "meg50+peg16", cell=CellBelief("nominal"))
WRIST = "wrist_wide"
SCENE = scene_of(CELL)


@lru_cache
def path(seed: int, name: str = "look"):
    motion = look_motion(name, SCENE, 100.0, 16.0)
    forth = motion.q_cmd if seed % 2 else motion.q_cmd[::-1]
    return CubicSpline(motion.time, forth)


def pictured(
    seed: int, *effects: EffectInstance, frames: int = 10, motion: str = "look", errs: float = 0.0
) -> Recording:
    """A recording of joints that read `effects` too, and of pictures in one of the looks of S.

    `errs` rad is by how much each joint is off what it reads (1 sigma), anew every 0.4 s.
    """
    cameras = cameras_of([WRIST], SCENE, (200, 150))
    curve = path(seed, motion)
    stamps = np.linspace(1.0, 15.0, frames)
    world = CELL.add(*effects, *look_of(f"S/{seed}", SCENE))
    time, knots = np.arange(0.0, 16.0, 0.01), np.arange(0.0, 16.4, 0.4)
    off = CubicSpline(knots, errs * np.random.default_rng(seed).normal(size=(len(knots), len(SCENE.joints))))
    shots = photograph(SCENE, cameras, world, lambda t: curve(t) + off(t), stamps, seed)
    q = curve(time)
    for e in effects:
        if e.effect == "encoder_offset":
            q[:, SCENE.joints.index(e.where)] += e.params["offset"].value
    rec = Recording(Path(f"look-{seed}"), "iiwa14", SCENE.joints, 100.0, Control(), time, q)
    return replace(rec, frames=shots, cell=CELL.cell)


def diagnose(fitted, held_out):
    return CHANNELS["pictures"].diagnose(CELL, (fitted, held_out), How())


def diagnosed(*effects: EffectInstance):
    return diagnose([pictured(3, *effects)], [pictured(4, *effects)])


def test_an_offset_and_a_focal_error_are_named_and_fitted():
    found = diagnosed(
        EffectInstance.of("camera_offset", WRIST, x=0.004), EffectInstance.of("focal_error", WRIST, fx=0.02, fy=0.02)
    )
    record = found.record
    assert record["verdict"] == "identified"
    values = {e.effect: {k: v.value for k, v in e.params.items()} for e in found.world.effects}
    assert set(values) == {"camera_offset", "focal_error"}
    assert abs(values["camera_offset"]["x"] - 0.004) < 3e-4
    assert abs(values["focal_error"]["fx"] - 0.02) < 3e-3 and abs(values["focal_error"]["fy"] - 0.02) < 3e-3
    errors = [rung["heldout_error"] for rung in record["ladder"]]
    assert errors[-1] < errors[0] / 5
    assert errors[-1] == record["channels"][0]["after"], "the last rung is the model written"
    assert found.world.cell == CELL.cell
    for e in record["effects"]:
        assert errors[-1] < e["without"] * record["noise_floor"]["value"] and 0.0 < e["explains"] < 1.1
    _check_silent(record)


@pytest.mark.slow
def test_a_partial_effect_is_fitted_anew_and_keeps_its_value_beside_what_the_sensor_does():
    hidden = EffectInstance.of("camera_offset", WRIST, x=0.009), EffectInstance.of("depth_bias", WRIST, offset=0.005)
    given = CELL.add(replace(EffectInstance.of("camera_offset", WRIST, x=0.004), partial=True))
    both = [pictured(3, *hidden)], [pictured(4, *hidden)]
    found = CHANNELS["pictures"].diagnose(given, both, How())
    assert [e.effect for e in found.world.effects] == ["camera_offset", "depth_bias"]
    x = found.world.effects[0].params["x"]
    assert x.value == pytest.approx(0.009, abs=2e-4) and x.high - x.low < 3e-4
    assert found.record["effects"][0]["params"]["x"]["value"] == x.value


def _check_silent(record):
    """Check that a diagnosis says of the same effects that they were not excited as a look at the motion alone."""
    silent = {(row["effect"], row["where"], *row.get("numbers", ())) for row in record["views"]["not_excited"]}
    beforehand = not_excited(excitations(SCENE, pictured(4), CELL))
    assert {(row["effect"], row["where"], *row.get("numbers", ())) for row in beforehand} == silent
    assert {"white_balance", "exposure"} <= {name for name, *_ in silent}


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_hidden():
    record = diagnosed().record
    assert record["verdict"] == "adequate" and not record["effects"], record["reason"]
    _check_silent(record)


@pytest.mark.slow
def test_a_camera_at_rest_shows_nothing_of_time_and_one_without_depth_nothing_of_depth():
    rec = pictured(3, frames=8)
    still = replace(rec.frames, frames=tuple(replace(f, rgb_source=rec.frames[0].rgb) for f in rec.frames))
    without = tuple(replace(f, depth_source=None) for f in still)
    resting = replace(
        rec, q=np.tile(path(3)(rec.frames[0].time), (len(rec.q), 1)), frames=replace(still, frames=without)
    )
    rows = {x.effect: x for x in excitations(SCENE, resting, CELL)}
    assert not any(rows[name].excited for name in ("camera_delay", "rolling_shutter"))
    assert "exposure" in rows["motion_blur"].silent and rows["rgb_noise"].excited and rows["camera_offset"].excited
    assert not {"depth_scale", "depth_bias", "depth_noise", "depth_dropout", "edge_fattening"} & set(rows)


@pytest.mark.slow
def test_an_encoder_s_offset_is_not_called_a_camera_s():
    found = diagnosed(EffectInstance.of("encoder_offset", "joint4", offset=0.012))
    (placed,) = found.world.effects
    assert (placed.effect, placed.where) == ("encoder_offset", "joint4")
    assert abs(placed.params["offset"].value - 0.012) < 2e-3


@pytest.mark.slow
def test_a_named_effect_is_fitted_to_pictures():
    hidden = EffectInstance.of("camera_offset", WRIST, x=0.004)
    result = fit(CELL, pictured(3, hidden), ["camera_offset:wrist_wide"])
    (placed,) = result.effects
    for name, v in placed.params.items():
        truth = 0.004 if name == "x" else 0.0
        assert abs(v.value - truth) < (3e-4 if name in "xyz" else 2e-3)
    assert result.record["ladder"][-1]["fit_error"] < result.record["ladder"][0]["fit_error"] / 5


@pytest.mark.slow
def test_a_fixture_that_stands_elsewhere_is_no_effect_of_a_camera():
    record = diagnosed(EffectInstance.of("hole_offset", "fixture", x=0.01, y=0.006)).record
    assert record["verdict"] == "unexplained"


@pytest.mark.slow
def test_a_fixture_that_was_moved_between_the_recordings_is_said_to_be():
    moved = EffectInstance.of("hole_offset", "fixture", x=0.005)
    for some in (((), (moved,)), ((moved,), ())):
        fitted, held_out = (pictured(seed, *e) for seed, e in zip((3, 4), some, strict=True))
        record = diagnose([fitted], [held_out]).record
        assert record["verdict"] == "unexplained" and "mm elsewhere" in record["reason"], record["reason"]


@pytest.mark.slow
def test_a_short_rolling_shutter_is_no_error_of_the_arm_and_lies_in_its_interval():
    hidden = EffectInstance.of("rolling_shutter", WRIST, readout=0.015)
    found = diagnose(*([pictured(s, hidden, motion="look-fast", errs=1.25e-4)] for s in (3, 4)))
    (placed,) = found.world.effects
    readout = placed.params["readout"]
    assert placed.effect == "rolling_shutter" and readout.low < 0.015 < readout.high < 0.02
    assert found.record["views"]["robot_rad"] < 3e-4


def smeared(rec: Recording, px: float = 1.0) -> Recording:
    """The pictures through grease on the middle of the lens: softer, paler, and displaced by `px` at most."""
    import cv2

    out = []
    for frame in rec.frames:
        height, width = frame.rgb.shape[:2]
        v, u = np.mgrid[:height, :width].astype(np.float32)
        drop = np.exp(-((u - 0.6 * width) ** 2 + (v - 0.5 * height) ** 2) / (0.22 * width) ** 2).astype(np.float32)
        soft = 0.8 * cv2.GaussianBlur(frame.rgb, (0, 0), 1.5).astype(np.float32) + 35
        image = frame.rgb * (1 - drop[..., None]) + drop[..., None] * soft
        image = cv2.remap(image.astype(np.float32), u + px * drop, v + 0.5 * px * drop, cv2.INTER_LINEAR)
        out.append(replace(frame, rgb_source=np.clip(np.rint(image), 0, 255).astype(np.uint8)))
    return replace(rec, frames=replace(rec.frames, frames=tuple(out)))


@pytest.mark.slow
def test_a_smear_on_the_lens_is_no_error_of_the_joints():
    record = diagnose(*([smeared(pictured(seed, frames=8))] for seed in (3, 4))).record
    assert record["verdict"] == "unexplained" and "a smear or streak on the lens" in record["reason"], record["reason"]
    assert record["views"]["robot_rad"] == 0.0 and record["views"]["field_px"] > 0.2


def test_what_the_joints_are_taken_to_be_off_by_is_said_beside_their_noise():
    rec = Recording(
        Path("x"), "iiwa14", SCENE.joints, 100.0, Control(), np.zeros(2), np.zeros((2, 7)), noise={"q": 2e-5}
    )
    assert _joints_said(1.0e-3, [rec]).endswith(
        "1 mrad in each frame (1 sigma), estimated from the pictures, 50 times the encoders' stated noise"
    )
    assert "stated" not in _joints_said(1.0e-3, [replace(rec, noise={})]) and _joints_said(0.0, [rec]) == ""
    assert max(robots()) == RULES.posture_frame  # no more than an arm errs that nobody calibrated


@pytest.mark.slow
def test_a_late_camera_is_named():
    found = diagnosed(EffectInstance.of("camera_delay", WRIST, delay=0.04))
    (placed,) = found.world.effects
    assert placed.effect == "camera_delay"
    assert abs(placed.params["delay"].value - 0.04) < 4e-3


def test_halves_that_differ_by_more_than_they_promise_are_a_model_error():
    left, floor = [Left("part", 0.02, 0.05, "table")], 0.18
    assert decide(2.0, 0.2, floor, 1, [], left, Halves(0.2, 0.09), 0.1).verdict == "identified"
    assert decide(2.0, 0.2, floor, 1, [], left, Halves(0.6, 0.09), 0.1).verdict == "unexplained"
    assert Halves(0.31, 0.15).disagree and not Halves(0.31, 0.15, views=5).disagree
    elsewhere = [Left("part", 0.6, 3.0, "fixture")]
    assert decide(2.0, 2.0, floor, 0, [], elsewhere, None, 0.1).verdict == "unexplained"
    assert decide(0.2, 0.2, floor, 0, [], left, None, 0.1).verdict == "adequate"
    moved = [Left("part", 0.08, 1.8, "fixture")]  # most of a moved part's edges are no longer near its borders
    assert decide(0.2, 0.2, floor, 0, [], moved, None, 0.1).verdict == "unexplained"
    smeared = decide(0.2, 0.2, floor, 0, [], left, None, 0.1, field=0.3)
    assert smeared.verdict == "unexplained" and "0.3 px (RMS)" in smeared.reason and "in the image" in smeared.reason
    far = decide(9.0, 8.0, floor, 0, [], left, None, 0.7)
    assert far.verdict == "unexplained" and "outside the search range of 8 cm and 8 degrees" in far.reason


def test_what_is_left_is_judged_against_the_floor_whatever_was_found():
    left, floor = [Left("part", 0.02, 0.05, "table")], 0.13
    above = decide(0.39, 0.39, floor, 0, [], left, None, 0.1)
    assert above.verdict == "unexplained" and "3.0 times what a right model leaves" in above.reason
    assert decide(0.6, 0.39, floor, 1, [], left, None, 0.1).verdict == "unexplained"
    assert decide(5.0, 0.39, floor, 1, [], left, None, 0.1).verdict == "identified"  # of an error forty times the floor
    assert decide(0.6, 0.16, floor, 1, [], left, None, 0.1).verdict == "identified"
    between = decide(0.12, 0.12, floor, 0, [], left, None, 0.1, ("parcel", 5.2))
    assert "the parcel stands 5.2 mm elsewhere in the held-out recordings" in between.reason


def test_whitening_is_the_inverse_root_of_the_covariance():
    rng = np.random.default_rng(0)
    unknowns = rng.normal(size=(30, 4)) @ np.diag([3.0, 1.0, 0.1, 0.0])
    whiten = Whitener.of(unknowns)
    covariance = np.eye(30) + unknowns @ unknowns.T
    root = whiten(np.eye(30))
    assert np.allclose(root @ covariance @ root, np.eye(30), atol=1e-9)
    assert np.isclose(whiten.logdet, np.linalg.slogdet(covariance)[1])


def fitted(values: np.ndarray, sigma: np.ndarray) -> Fit:
    """A fit of a camera's offset, six numbers."""
    world = CELL.add(EffectInstance.of("camera_offset", WRIST))
    space = Space(world, [0])
    return Fit(world, np.zeros(0), (np.zeros((0, 6)),), space, values, sigma, np.eye(6))


def test_two_recordings_that_disagree_widen_an_interval_to_their_own_spread():
    fit, other = fitted(np.zeros(6), np.full(6, 0.01)), np.array([0.0, 0.0, 0.0, 0.0, 0.002, 0.2])
    wide = widened(fit, replace(fit, u=other), 1000)
    more = (0.002**2 + 0.2**2) / 2 / 6 / 0.01**2 - 1  # of the variance, by all six numbers
    assert wide.sigma[:5] == pytest.approx(0.01 * np.sqrt(1 + more))
    assert wide.sigma[5] == pytest.approx(0.2 / np.sqrt(2))
    rz, axis = wide.world.effects[0].params["rz"], wide.space.axes[5]
    freedom = (1 + more) ** 2 / (1 / 994 + more**2 / 6)
    assert rz.high - rz.low == pytest.approx(2 * stats.t.ppf(0.975, freedom) * wide.sigma[5] * axis.unit, rel=2e-3)
    assert widened(fit, fit, 1000).sigma == pytest.approx(fit.sigma)


@pytest.mark.parametrize("spread", [1.0, 2.0, 5.0])
def test_intervals_hold_the_truth_whatever_lies_between_two_recordings(spread):
    rng, held = np.random.default_rng(1), []
    for _ in range(300):
        one, other = 0.05 * spread * rng.normal(size=(2, 6))
        fit = fitted(one, 0.05 * np.sqrt(rng.chisquare(6, size=6) / 6))
        wide = widened(fit, replace(fit, u=other), 12)
        params = [wide.world.effects[0].params[a.name] for a in wide.space.axes]
        held += [v.low <= 0.0 <= v.high for v in params]
    assert np.mean(held) > 0.94


def test_a_figure_that_is_off_in_all_frames_moves_what_depends_on_it():
    rng = np.random.default_rng(2)
    fit = replace(fitted(np.zeros(6), np.ones(6)), columns=(rng.normal(size=(40, 6)),))
    moves = rng.normal(size=6)
    assert of_form(fit, (fit.jacobian @ moves)[:, None]) == pytest.approx(np.abs(moves))
    assert of_form(fit, np.zeros((40, 0))) == pytest.approx(np.zeros(6))


@pytest.mark.slow
def test_a_depth_camera_s_scale_is_named_and_nothing_else():
    result = diagnosed(EffectInstance.of("depth_scale", WRIST, factor=1.02))
    assert result.record["verdict"] == "identified"
    (found,) = result.world.effects
    assert found.label == f"depth_scale({WRIST})"
    assert found.params["factor"].low <= 1.02 <= found.params["factor"].high
    (named,), nominal, floor = result.record["effects"], result.record["ladder"][0], result.record["noise_floor"]
    assert named["without"] == pytest.approx(nominal["heldout_error"] / floor["value"])
    assert 0.5 < named["explains"] < 1.1, "its figures, of which some do not depend on it"


@pytest.mark.slow
def test_a_small_error_of_the_lens_is_named_or_said_to_be_alike_with_px_and_a_motion():
    record = diagnosed(EffectInstance.of("focal_error", WRIST, fx=0.008, fy=0.008)).record
    assert {e["effect"] for e in record["effects"]} == {"focal_error"}
    rivals = [r for e in record["effects"] for r in e["indistinguishable_from"]]
    assert len(record["views"]["confounded"]) == len(rivals)
    for row in record["views"]["confounded"]:
        assert row["views_px"] < 0.2 and row["motion"] and row["projection"]


@pytest.mark.parametrize("views", [4, 5, 10, 40])
def test_two_halves_of_one_law_agree_however_few_their_views_are(views):
    """Two means of `views` readings each, their uncertainty from the readings' own spread."""
    rng = np.random.default_rng(views)
    one, other = rng.normal(size=(2, 4000, views))
    spread = np.sqrt((one.var(axis=1, ddof=1) + other.var(axis=1, ddof=1)) / views)
    away = np.abs(one.mean(axis=1) - other.mean(axis=1))
    wrong = np.mean([Halves(9 * d, 9 * s, views).disagree for d, s in zip(away, spread, strict=True)])
    assert wrong < 0.055
