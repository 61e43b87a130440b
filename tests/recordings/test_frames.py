"""Frames beside samples: they come back as they were, joints are where the robot stood, and bad files end in a line."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml
from made import recording

from vispeg.core.errors import UserError
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.recordings.frames.joints import joints_at
from vispeg.recordings.load import load
from vispeg.recordings.write import write

POSE = np.array([[0.0, -1, 0, 0.1], [1, 0, 0, -0.2], [0, 0, 1, 1 / 3], [0, 0, 0, 1]])
WRIST = RecordedCamera("wrist", 16, 12, 17.1, 17.3, 7.5, 5.5, (0.1, -0.02, 1e-3, 0.0, 0.0), 1e-4, "flange", POSE)
ROOM = RecordedCamera("room", 10, 10, 20.0, 20.0, 4.5, 4.5)


def frames(times=(0.1, 0.5, 0.9), episode=0):
    rng = np.random.default_rng(1)
    out = []
    for t in times:
        depth = rng.uniform(0.1, 3.0, (12, 16)).astype(np.float32)
        depth[0, :3] = (0, np.nan, np.inf)
        out.append(RecordedFrame(t, WRIST, rng.integers(0, 256, (12, 16, 3), np.uint8), depth, episode))
        out.append(RecordedFrame(t, ROOM, rng.integers(0, 256, (10, 10, 3), np.uint8), None, episode))
    return Frames({"wrist": WRIST, "room": ROOM}, tuple(out))


@pytest.fixture
def folder(tmp_path):
    return write(recording(frames=frames()), tmp_path / "rig")


def test_frames_come_back(folder, tmp_path):
    """Colour bit for bit, depth to half a step, no reading as 0, calibration exactly; and again from the copy."""
    there, truth = load(folder).frames, frames()
    again = load(write(load(folder), tmp_path / "again")).frames
    for read in (there, again):
        assert read is not None and read.names == ["wrist", "room"]
        for found, made in zip(read, truth, strict=True):
            assert (found.time, found.camera.name) == (made.time, made.camera.name)
            assert np.array_equal(found.rgb, made.rgb)
            if made.depth is None:
                assert found.depth is None
                continue
            good = np.isfinite(made.depth) & (made.depth > 0)
            assert np.abs(found.depth - made.depth)[good].max() <= 0.51 * WRIST.depth_unit
            assert found.depth.dtype == np.float32 and not found.depth[~good].any()
        wrist = read.cameras["wrist"]
        assert np.array_equal(wrist.pose, POSE) and wrist.mount == "flange" and read.cameras["room"].mount is None
        assert all(getattr(wrist, k) == getattr(WRIST, k) for k in ("fx", "fy", "cx", "cy", "distortion", "depth_unit"))


def test_pixels_are_read_when_asked_for(folder):
    """A damaged body passes the look at the heads, and ends in one line when the pixels are wanted."""
    file = folder / "frames" / "wrist-00001-rgb.png"
    data = bytearray(file.read_bytes())
    data[60:-20] = bytes(len(data) - 80)
    file.write_bytes(data)
    row = load(folder).frames.of("wrist")[1]
    with pytest.raises(UserError, match="wrist-00001-rgb.png: is a damaged PNG"):
        _ = row.rgb
    assert row.depth is not None


def test_episodes_keep_their_frames(tmp_path):
    two = recording(n=1000, episode=np.repeat([3, 7], 500), time=np.tile(np.arange(500) / 500, 2))
    both = Frames(frames().cameras, (*frames(episode=3), *frames((0.2,), episode=7)))
    read = load(write(replace(two, frames=both), tmp_path / "rig")).frames
    assert read.episodes.tolist() == [3] * 6 + [7] * 2 and read.of("room").times.tolist() == [0.1, 0.5, 0.9, 0.2]


def test_samples_cut_to_one_episode_do_not_take_the_frames_of_another(tmp_path):
    both = Frames(frames().cameras, (*frames(episode=3), *frames((0.2,), episode=7)))
    one = recording(n=500, episode=np.repeat(7, 500), time=np.arange(500) / 500)
    with pytest.warns(UserWarning, match="6 of 8 frames outside the times of the samples"):
        read = load(write(replace(one, frames=both), tmp_path / "rig")).frames
    assert read.episodes.tolist() == [7, 7] and set(read.times.tolist()) == {0.2}


def test_joints_between_samples():
    """The spline's error on a sine falls with the fourth power of the period; gaps and the outside are unknown."""
    errors = []
    for rate in (50.0, 100.0):
        time = np.arange(int(2 * rate)) / rate
        angle = np.sin(2 * np.pi * 1.5 * time)
        rec = recording(time=time, q=np.stack([angle, angle], 1), rate_hz=rate)
        at = np.linspace(0.3, 1.7, 997)
        errors.append(np.abs(joints_at(rec, at)[:, 0] - np.sin(2 * np.pi * 1.5 * at)).max())
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.1)
    hole = rec.q.copy()
    hole[80:90, 0] = np.nan
    found = joints_at(replace(rec, q=hole), np.array([-0.1, 0.5, 0.85, 0.79, 2.5]))
    assert np.isnan(found[:, 0]).tolist() == [True, False, True, False, True]
    assert np.isnan(found[:, 1]).tolist() == [True, False, False, False, True]


def edited(folder, name, old, new):
    file = folder / "frames" / name
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def size(folder):
    import cv2

    cv2.imwrite(str(folder / "frames" / "room-00000-rgb.png"), np.zeros((9, 10, 3), np.uint8))


def shallow(folder):
    import cv2

    cv2.imwrite(str(folder / "frames" / "wrist-00000-depth.png"), np.zeros((12, 16), np.uint8))


def cut(folder):
    file = folder / "frames" / "wrist-00002-depth.png"
    file.write_bytes(file.read_bytes()[:-30])


def camera(folder, **changes):
    file = folder / "frames" / "cameras.yaml"
    data = yaml.safe_load(file.read_text())
    data["wrist"] |= changes
    file.write_text(yaml.safe_dump(data))


BAD = {
    "no cameras": (lambda f: (f / "frames" / "cameras.yaml").unlink(), "cameras.yaml: no such file"),
    "no index": (lambda f: (f / "frames" / "index.csv").unlink(), "index.csv: no such file"),
    "no picture": (lambda f: (f / "frames" / "room-00001-rgb.png").unlink(), "line 5, column rgb: no such picture"),
    "size": (size, "has another size; expected 10 x 10 px, as camera 'room' in cameras.yaml; got '10 x 9'"),
    "depth of 8 bits": (shallow, "wrist-00000-depth.png: has the wrong type; expected a 16-bit picture"),
    "cut": (cut, "wrist-00002-depth.png: is cut short"),
    "text": (lambda f: (f / "frames" / "wrist-00000-rgb.png").write_text("x" * 50), "is not a PNG"),
    "nan": (lambda f: edited(f, "index.csv", "0.5,wrist", "nan,wrist"), "line 4, column time: is not a finite number"),
    "who": (lambda f: edited(f, "index.csv", "0.5,wrist", "0.5,wrst"), "did you mean 'wrist'"),
    "twice": (lambda f: edited(f, "index.csv", "0.5,wrist", "0.1,wrist"), "two frames of one camera at one time"),
    "empty": (lambda f: edited(f, "index.csv", "room-00000-rgb.png", ""), "line 3: has no picture"),
    "out": (lambda f: edited(f, "index.csv", "room-00000-rgb.png", "../x.png"), "leads out of frames/"),
    "clock": (
        lambda f: (f / "frames" / "index.csv").write_text("time,camera,rgb\n1700000000.5,room,room-00000-rgb.png\n"),
        "1 of 1 frame outside the times of the samples; expected times from 0 to",
    ),
    "focal": (lambda f: camera(f, fx=-3.0), "wrist.fx"),
    "nan focal": (lambda f: camera(f, fy=float("nan")), "wrist.fy: is not finite"),
    "no rotation": (lambda f: camera(f, flange_T_camera=np.ones((4, 4)).tolist()), "pose that is not a rigid motion"),
    "two poses": (lambda f: camera(f, base_T_camera=np.eye(4).tolist()), "both base_T_camera and flange_T_camera"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_frames_end_in_one_line(folder, case):
    break_it, said = BAD[case]
    break_it(folder)
    with pytest.raises(UserError) as caught:
        load(folder)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_what_a_camera_saw_outside_the_log_is_left_out(folder):
    edited(folder, "index.csv", "0.9,wrist", "1.9,wrist")
    with pytest.warns(UserWarning, match="1 of 6 frames outside the times of the samples: left out"):
        there = load(folder).frames
    assert len(there) == 5


def test_a_recording_without_frames_has_none(folder):
    shutil.rmtree(folder / "frames")
    assert load(folder).frames is None


def test_a_picture_that_does_not_fit_its_camera_is_not_written(tmp_path):
    wrong = Frames({"room": ROOM}, (RecordedFrame(0.1, ROOM, np.zeros((9, 9, 3), np.uint8)),))
    with pytest.raises(UserError, match="has another size"):
        write(recording(frames=wrong), tmp_path / "rig")
    assert not (tmp_path / "rig").exists()
