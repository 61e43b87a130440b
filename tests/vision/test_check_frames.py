"""What `check` says of frames: the faults that were put in, and what motions tell and leave in the dark."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made import recording

from vispeg.api.recording.look import cameras_of, scene_of
from vispeg.identify.motions.look_motion import look_motion
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.render.cameras.standard import standard_cameras
from vispeg.robots.model import load
from vispeg.task.start import home
from vispeg.vision.blur import softness
from vispeg.vision.borders import Borders, borders_of
from vispeg.vision.check import check_frames, warnings_of
from vispeg.vision.eye import posed
from vispeg.vision.precision import View, _of_time, _robot, precisions
from vispeg.vision.predict import Predictor
from vispeg.vision.search import search
from vispeg.worlds.world import World

EYE = RecordedCamera("eye", 32, 24, 30.0, 30.0, 15.5, 11.5)
CELL = World("iiwa14", "meg50+peg16", cell=CellBelief("nominal"))


def of_frames(times, pictures, depth=None):
    frames = tuple(RecordedFrame(float(t), EYE, p, depth) for t, p in zip(times, pictures, strict=True))
    return recording(n=1000, frames=Frames({"eye": EYE}, frames))


def grey(level, n):
    rng = np.random.default_rng(0)
    return [np.clip(rng.normal(level, 4, (24, 32, 3)), 0, 255).astype(np.uint8) for _ in range(n)]


def test_lost_repeated_and_badly_lit_frames_are_counted():
    times = np.delete(np.arange(20) * 0.1, [5, 6, 11])
    pictures = grey(128, 17)
    pictures[4] = pictures[3]
    depth = np.full((24, 32), 0.5, np.float32)
    depth[:12] = 0
    (found,) = check_frames(of_frames(times, pictures, depth), None)
    assert (found.lost, found.repeated, found.frames) == (3, 1, 17) and found.rate_hz == pytest.approx(10)
    assert found.fill_rate == 50.0 and found.near == pytest.approx(0.5) and abs(found.brightness - 128) < 1
    assert not found.precision and found.coverage is None
    said = " ".join(warnings_of(found))
    assert "3 frames lost" in said and "1 frame the same as the one before" in said and "50 % of the depth" in said
    (bright,) = check_frames(of_frames(np.arange(3) * 0.1, [np.full_like(p, 255) for p in grey(128, 3)]), None)
    assert bright.saturated > 0.9 and "expose less" in " ".join(warnings_of(bright))


@pytest.mark.parametrize("sigma", [0.7, 1.2, 2.0])
def test_softness_is_the_blur_that_was_put_in(sigma):
    from scipy.special import erf

    n, at = 40, 40.0
    column = 100 + 60 * erf((np.arange(80) - at) / np.sqrt(2) / sigma)
    picture = np.repeat(np.tile(np.rint(column), (3 * n, 1))[..., None], 3, 2).astype(np.uint8)
    pixel = np.stack([np.full(n, 39.0), np.arange(n) * 3.0 + 1], 1)
    pair, zero = np.ones((n, 2), int), np.zeros(n)
    borders = Borders(
        pixel, np.tile([1.0, 0.0], (n, 1)), pair, zero, pair[:, 0], np.zeros((n, 3)), np.full((n, 2), 12.0)
    )
    found = softness(picture, borders, search(picture, borders))
    assert np.nanmedian(found) == pytest.approx(np.hypot(sigma, 0.3), rel=0.1)


def test_a_camera_of_the_robot_s_file_gives_its_pose_whether_it_states_a_resolution_or_not(tmp_path):
    arm = """<mujoco><worldbody><camera name="eye" pos="0 0 2" fovy="50" {}/><body name="b"><joint name="j"/>
      <geom size=".1"/><site name="flange"/></body></worldbody></mujoco>"""
    for stated in ("", 'resolution="64 48"'):
        (tmp_path / "arm.xml").write_text(arm.format(stated))
        (camera,) = posed(Frames({"eye": EYE}, ()), load(tmp_path / "arm.xml")).cameras.values()
        assert camera.mount == "base" and camera.pose is not None and camera.width == EYE.width
        assert camera.pose[:3, 3].tolist() == [0, 0, 2]


@pytest.mark.parametrize(("camera", "moved"), [("wrist_wide", "standing"), ("external", "carried")])
def test_the_arm_s_repeatability_moves_what_it_carries_against_the_rest(camera, moved):
    """Seen from the wrist the scene moves; seen from a fixed camera, the hand."""
    scene = scene_of(CELL)
    assert scene is not None
    small = {"width": 160, "height": 120, "fx": 150.0, "fy": 150.0, "cx": 79.5, "cy": 59.5}
    cameras = [c.moved(**small) for c in standard_cameras() if c.name == camera]
    with Predictor(scene, cameras) as predictor:
        geometry, q = predictor.geometry, home(scene) + [0, 0, 0, 0, 0, 0.3, 0]  # the hole in sight of the wrist
        view = View(borders_of(predictor.draw(camera, q), geometry, step=1.0), q, np.zeros(7))
        found = _robot(np.ones((len(view.borders), 6)), view, geometry, camera)
    hand = scene.compile().body("tool").id
    model = geometry.model
    weld = model.body_weldid[view.borders.body]
    standing, carried = weld == 0, weld == model.body_weldid[hand]
    assert min(standing.sum(), carried.sum()) > 5
    rows = {"standing": standing, "carried": carried}
    assert (found[rows.pop(moved)] == np.repeat([1e-4, 3.5e-4], 3)).all()
    assert not found[next(iter(rows.values()))].any()


def told(name, scene, cameras, fixed=False):
    motion = look_motion(name, scene, 100.0, 16.0)
    views = []
    with Predictor(scene, cameras) as predictor:
        for i in range(75, 1550, 150):
            q = motion.q_cmd[75 if fixed else i]
            borders = borders_of(predictor.draw("wrist_wide", q), predictor.geometry)
            views.append(View(borders, q, 0 * q if fixed else motion.dq_cmd[i]))
        return {f"{t.effect}.{t.parameter}": t for t in precisions(predictor.geometry, "wrist_wide", views)}


def test_motions_tell_what_theory_says():
    """A focal length needs tilt or range, a delay needs sideways motion both ways; the mixed look tells all."""
    cameras = cameras_of(["wrist_wide"], scene_of(CELL), (200, 150))
    scene = scene_of(CELL, cameras)
    every = {name: told(name, scene, cameras) for name in ("look", "look-roll", "look-sideways")}
    still = told("look", scene, cameras, fixed=True)
    for key, mixed in every["look"].items():
        assert mixed.sigma < min(one[key].sigma for one in (*list(every.values())[1:], still)), key
    assert every["look"]["camera_delay.delay"].sigma < 4.0 and every["look"]["camera_offset.rz"].determined
    of_time = ("camera_delay.delay", "rolling_shutter.readout")
    assert not any(still[key].determined for key in (*of_time, "camera_offset.z", "focal_error.fx"))
    for key in of_time:
        assert still[key].sigma > 400, "nothing moves: the prior is all there is"
        assert every["look-sideways"][key].sigma < 0.3 * every["look-roll"][key].sigma
    assert every["look"]["focal_error.fx"].sigma < 0.5 * every["look-sideways"]["focal_error.fx"].sigma


def test_lower_rows_see_a_border_as_an_earlier_camera_would():
    """Half of the read-out before the middle row at the top, half after it at the bottom, nothing in the middle."""
    n, normal = 3, np.tile([1.0, 0.0], (3, 1))
    pixel, zero = np.stack([np.zeros(n), [0.0, 49.5, 99.0]], 1), np.zeros(n)
    borders = Borders(pixel, normal, np.ones((n, 2), int), zero, np.ones(n, int), np.zeros((n, 3)), np.ones((n, 2)))
    late, rows = _of_time(np.full(n, 7.0), borders, 100)
    assert np.array_equal(late, [7.0, 7.0, 7.0]) and np.allclose(rows, [3.5, 0.0, -3.5])


def test_a_recording_without_a_cell_is_checked_all_the_same():
    rec = of_frames(np.arange(5) * 0.1, grey(100, 5))
    (found,) = check_frames(replace(rec, cell=None), None)
    assert found.tilt is None and found.softness is None and found.brightness is not None
