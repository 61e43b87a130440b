"""Pictures of a moving arm: a late camera sees the past, a rolling shutter each row at its time."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vispeg.api.recording.look import cameras_of, look_of, scene_of
from vispeg.api.recording.record import record
from vispeg.cli.main import main
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.identify.motions.look_motion import LOOKS, look_motion
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.frames.joints import joints_at
from vispeg.recordings.load import load
from vispeg.recordings.noise import NOISE
from vispeg.recordings.recording import Control, Recording
from vispeg.task.belief import believed
from vispeg.vision.borders import borders_of
from vispeg.vision.compare import compare_frames
from vispeg.vision.eye import camera_of
from vispeg.vision.photograph import photograph
from vispeg.vision.predict import Predictor
from vispeg.vision.search import search
from vispeg.vision.shutter import Shutter, exposed
from vispeg.worlds.model_file import load_model, without_origin
from vispeg.worlds.world import World

CELL = World("iiwa14", "meg50+peg16", cell=CellBelief("nominal"))
SMALL = (64, 48)
PICTURED = {"cameras": "wrist_wide", "size": SMALL, "backend": "raycast", "noise": dict.fromkeys(NOISE, 0.0)}


@pytest.fixture(scope="module")
def stage():
    cameras = cameras_of(["wrist_wide", "external"], scene_of(CELL), SMALL)
    scene = scene_of(CELL, cameras)
    motion = look_motion("look", scene, 100.0, 16.0)

    def path(times):
        return np.stack([np.interp(times, motion.time, q) for q in motion.q_cmd.T], 1)

    return scene, cameras, path


def taken(stage, times, *effects, **options):
    scene, cameras, path = stage
    return photograph(scene, cameras[:1], CELL.add(*effects), path, np.array(times), 0, backend="raycast", **options)


def test_a_late_camera_sees_the_past(stage):
    late = taken(stage, [5.2, 6.2], EffectInstance.of("camera_delay", "wrist_wide", delay=0.2))
    prompt = taken(stage, [5.0, 6.0])
    for a, b in zip(late, prompt, strict=True):
        assert np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth, b.depth)
    assert late.times.tolist() == [5.2, 6.2]
    assert not np.array_equal(prompt[0].rgb, prompt[1].rgb)


def test_a_camera_whose_joint_log_lags_sees_what_comes(stage):
    ahead = taken(stage, [5.0], EffectInstance.of("camera_delay", "wrist_wide", delay=-0.08))[0]
    assert np.array_equal(ahead.depth, taken(stage, [5.08])[0].depth)


@pytest.mark.parametrize(
    "placed",
    [
        EffectInstance.of("rolling_shutter", "wrist_wide", readout=0.12),
        EffectInstance.of("motion_blur", "wrist_wide", exposure=0.12, length=0.0, angle=0.0),
        EffectInstance.of("camera_delay", "wrist_wide", delay=-0.08),
        EffectInstance.of("depth_scale", "wrist_wide", factor=1.05),
        EffectInstance.of("vignetting", "wrist_wide", amount=1.4),
    ],
    ids=lambda e: e.effect,
)
def test_a_model_that_states_an_effect_predicts_its_pictures(placed, stage):
    """Photographs of a world against the world itself and against the nominal one: the stated effect is no error."""
    scene, _, path = stage
    cameras = cameras_of(["wrist_wide"], scene_of(CELL), (160, 120))
    time = np.arange(0.0, 16.0, 0.01)
    frames = photograph(scene, cameras, CELL.add(placed), path, np.array([5.0, 5.6]), 0, backend="raycast", finer=1)
    rec = Recording(Path("look"), "iiwa14", scene.joints, 100.0, Control(), time, path(time), frames=frames)
    stated, plain = (compare_frames(rec, scene, w, backend="raycast") for w in (World().add(placed), World()))
    for one, other in zip(stated, plain, strict=True):
        errors = [(one.border_rms, other.border_rms, 0.6), (one.depth_rms, other.depth_rms, 0.1)]
        errors.append((one.light_rms, other.light_rms, 0.1))
        assert all(a < least for a, _, least in errors), errors
        assert any(b > 2 * a for a, b, _ in errors), errors


def test_each_row_of_a_rolling_shutter_has_its_time(stage):
    """The first and the last strip are those of pictures taken at their times; without readout nothing changes."""
    scene, cameras, path = stage
    with Predictor(scene, cameras, "raycast") as predictor:
        shutter = Shutter(0.01, 0.4, 0.0)
        seen = exposed(predictor, "wrist_wide", shutter, path, 5.0)
        rgb, depth = seen.rgb, seen.depth
        strips, _ = shutter.moments()
        assert np.mean(strips) == pytest.approx(-0.01) and np.ptp(strips) == pytest.approx(0.4 * 7 / 8)
        for rows, strip in ((slice(0, 6), strips[0]), (slice(42, 48), strips[-1])):
            alone = predictor.draw("wrist_wide", path(np.array([5.0 + strip]))[0])
            assert np.array_equal(rgb[rows], alone.rgb[rows]) and np.array_equal(depth[rows], alone.depth[rows])


def test_blur_comes_from_motion(stage):
    """At rest an open shutter changes nothing; in motion it takes from the picture's sharpness."""
    scene, cameras, path = stage
    blur = EffectInstance.of("motion_blur", "wrist_wide", exposure=0.1, length=0.0, angle=0.0)
    still = photograph(scene, cameras[:1], CELL.add(blur), lambda t: path(0 * t), np.array([5.0]), 0, backend="raycast")
    plain = photograph(scene, cameras[:1], CELL, lambda t: path(0 * t), np.array([5.0]), 0, backend="raycast")
    assert np.abs(still[0].rgb.astype(int) - plain[0].rgb).max() <= 1
    moving = [
        np.abs(np.diff(f[0].rgb.astype(float), axis=0)).max() for f in (taken(stage, [5.6], blur), taken(stage, [5.6]))
    ]
    assert moving[0] < 0.9 * moving[1]


def test_more_rays_change_borders_alone(stage):
    scene, cameras, path = stage
    coarse, fine = taken(stage, [5.0], finer=1)[0], taken(stage, [5.0], finer=3)[0]
    assert np.allclose(coarse.depth, fine.depth, atol=1e-5)
    off = np.abs(coarse.rgb.astype(int) - fine.rgb).max(-1)
    assert np.mean(off > 8) < 0.12 and off.max() > 8


@pytest.mark.parametrize("name", LOOKS)
def test_motions_are_fit_for_a_robot(name, stage):
    scene = stage[0]
    motion = look_motion(name, scene, 100.0, 24.0)
    assert np.abs(motion.dq_cmd[[0, -1]]).max() < 0.02
    assert np.allclose(np.gradient(motion.q_cmd, motion.time, axis=0)[1:-1], motion.dq_cmd[1:-1], atol=0.01)
    assert (np.abs(motion.dq_cmd) < scene.velocity_limit).all()
    assert ((motion.q_cmd > scene.range[:, 0]) & (motion.q_cmd < scene.range[:, 1])).all()
    turns = np.diff(np.sign(motion.dq_cmd), axis=0) != 0
    assert turns.sum(axis=0).max() >= (1 if name == "look-approach" else 3), "back and forth"


def test_a_motion_that_touches_is_photographed_where_the_arm_is():
    """Beside its wrench: pictures of the true arm, not of what its encoders read."""
    plant = load_model("peg-cell").add(EffectInstance.of("encoder_offset", "joint4", offset=0.01))
    options = {"rate_hz": 250.0, **PICTURED, "fps": 0.4}
    rec = record(plant, "tap", **options).recording
    assert rec.ft is not None and np.isfinite(rec.ft).all() and rec.frames is not None and len(rec.frames) >= 2
    scene = replace(believed(rec.cell).scene, cameras=("wrist_wide",))
    right, wrong = (compare_frames(rec, scene, w, backend="raycast") for w in (plant, World()))
    assert max(c.depth_rms for c in right) < 1.0 < min(c.depth_rms for c in wrong), "mm"
    with pytest.raises(UserError, match="pictures need a single run"):
        record(plant, "tap", repeat=2, **options)


def test_too_fast_a_look_is_refused(stage):
    with pytest.raises(UserError, match="look is too fast for joint.; expected 1.* s or more"):
        look_motion("look", stage[0], 100.0, 6.0)


def test_a_recording_shows_what_was_hidden(tmp_path, capsys):
    """Through the command line and back from disk: borders of an honest camera fit, those of a moved one do not."""
    off = []
    for number, extra in enumerate(([], ["--effects", "camera_offset:wrist_wide:x=0.004,rx=0.02,ry=0.02"])):
        out = tmp_path / f"rig-{number}"
        main(
            [
                "record",
                "peg-cell",
                "--motion",
                "look",
                "--size",
                "128x96",
                "--fps",
                "0.2",
                "--rate",
                "200",
                "--look",
                "S/4",
            ]
            + ["--out", str(out), "--json", *extra]
        )
        assert json.loads(capsys.readouterr().out)["frames"] == 3
        rec = load(out)
        assert rec.frames is not None and rec.cell == CellBelief("nominal")
        cameras = [camera_of(c) for c in rec.frames.cameras.values()]
        found = []
        with Predictor(scene_of(CELL, cameras), cameras) as predictor:
            for frame, q in zip(rec.frames, joints_at(rec, rec.frames.times), strict=True):
                seen = predictor.draw("wrist_wide", q)
                found.append(search(frame.rgb, borders_of(seen, predictor.geometry), window=6.0).along)
                there = (seen.depth > 0) & (frame.depth > 0)
                if not number:
                    assert np.median(np.abs(frame.depth - seen.depth)[there]) < 2e-4
        off.append(np.nanmedian(np.abs(np.concatenate(found))))
    assert off[0] < 0.3 and off[1] > 1.0


def test_the_arm_alone_has_no_cell():
    with pytest.raises(UserError, match="pictures need something to see.*robot"):
        record("iiwa14", "look")


def test_what_is_wrong_with_cameras_and_pictures_is_said(stage):
    """A rate that the joints' samples allow may still give too many pictures, and each is said by itself."""
    scene = stage[0]
    with pytest.raises(UserError, match="not a possible frame rate.*500 Hz; got 600"):
        record(CELL, "look", fps=600.0, rate_hz=500.0)
    with pytest.raises(UserError, match="too many pictures; expected at most 5000.*got 6400"):
        record(CELL, "look", fps=400.0, rate_hz=500.0, duration=16.0)
    with pytest.raises(UserError, match="cameras: two cameras have the same name"):
        cameras_of(["wrist_wide", "wrist_wide"], scene, (64, 48))
    with pytest.raises(UserError, match="cameras: no camera"):
        cameras_of([], scene, (64, 48))


def test_a_look_is_a_worlds(stage):
    scene = stage[0]
    first, again, other = (look_of(text, scene) for text in ("S/3", "S/3", "S/4"))
    assert first == again != other and first
    with pytest.raises(UserError, match="a world and a seed"):
        look_of("S", scene)


def test_what_the_joints_read_is_not_where_they_are(stage):
    """An encoder's offset turns the arm in the recording's plant; the pictures are of the true arm."""
    scene, cameras, path = stage
    offset = EffectInstance.of("encoder_offset", "joint6", offset=0.02)
    assert np.array_equal(taken(stage, [5.0], offset)[0].rgb, taken(stage, [5.0])[0].rgb)
    world = replace(CELL, effects=(offset,))
    rec = record(world, "look", fps=0.1, rate_hz=200.0, **PICTURED).recording
    assert rec.frames is not None
    with Predictor(scene, cameras[:1], "raycast") as predictor:
        frame, q = rec.frames[0], joints_at(rec, rec.frames.times)[0]
        errors = []
        for seen_world in (World(), world):
            predictor.see(seen_world)
            seen = predictor.draw("wrist_wide", q)
            both = (seen.depth > 0) & (frame.depth > 0)
            errors.append(np.mean(np.abs(seen.depth - frame.depth)[both]))
    assert errors[1] < 3e-4 < errors[0]


@pytest.mark.slow
def test_a_cell_is_recorded_with_the_effects_that_it_states():
    """Joints and pictures are those of a world that has the effects; those of what takes no part are ignored."""
    effects = (
        EffectInstance.of("hole_offset", "fixture", x=0.03),
        EffectInstance.of("camera_offset", "wrist_wide", x=0.01),
        EffectInstance.of("near_limit", "all", nearest=0.2),
        EffectInstance.of("encoder_offset", "joint6", offset=0.02),
    )
    idle = EffectInstance.of("camera_offset", "external", x=0.1), EffectInstance.of("object_mass", "peg", scale=2.0)
    cell = CellBelief("nominal", effects=tuple({**without_origin(e)} for e in (*effects, *idle)))
    options = {"fps": 0.2, "rate_hz": 100.0, **PICTURED}
    worlds = replace(CELL, cell=cell), CELL.add(*effects), CELL
    stating, having, plain = (record(world, "look", **options).recording for world in worlds)
    assert np.array_equal(stating.q, having.q) and stating.cell == cell
    for a, b, c in zip(stating.frames, having.frames, plain.frames, strict=True):
        assert np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth, b.depth)
        assert not np.array_equal(a.rgb, c.rgb) and not np.array_equal(a.depth, c.depth)
