"""One's own bench: a robot's file with what stands about it is a scene, and pictures of it name a camera's error."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from benches import HOME, write_bench, write_motion
from resuming import resumed
from typed_record import mistakes

import vispeg
from vispeg.api.compare import compare
from vispeg.api.fit import fit
from vispeg.api.inputs import read_model
from vispeg.api.recording.check import check
from vispeg.api.recording.record import record
from vispeg.core.errors import UserError
from vispeg.diagnosis.schema import ComparisonRecord
from vispeg.recordings.load import load as load_recording
from vispeg.recordings.recording import Control
from vispeg.recordings.write import write
from vispeg.render.cameras.model_camera import cameras_of
from vispeg.robots.bench import bench, shows
from vispeg.robots.examples import write_mjcf, write_urdf
from vispeg.robots.model import load
from vispeg.task.belief import robot_of_world
from vispeg.vision.geometry import Geometry

EYE = "eye_in_hand"
HIDDEN = [f"camera_offset:{EYE}:x=0.006"]
MODEL = """format: vispeg-model/1
robot: {robot}
cell: {cell}
"""
FOUND = """format: vispeg-model/1
robot: lab.xml
effects:
  - {effect: camera_offset, where: eye_in_hand, params: {x: 0.006}}
"""


def recorded(folder: Path, name: str, phase: float, fps: float = 1.2) -> Path:
    motion = write_motion(folder, f"{name}.csv", phase)
    made = record(str(write_bench(folder)), motion, cameras=[EYE], effects=HIDDEN, rate_hz=200.0, fps=fps)
    return made.save(folder / name)


def bare(folder: Path, source: Path) -> Path:
    """The same recording as a log of angles and pictures alone gives it, whose cameras.yaml says nothing of poses."""
    rec = load_recording(source)
    camera = replace(rec.frames.cameras[EYE], mount=None, pose=None)
    frames = tuple(replace(f, camera=camera) for f in rec.frames.frames)
    silent = {"tau": None, "q_cmd": None, "dq_cmd": None, "dq": None, "ee": None, "torque_sensor": "none"}
    rec = replace(rec, control=Control(), frames=replace(rec.frames, cameras={EYE: camera}, frames=frames), **silent)
    return write(rec, folder / f"{source.name}-bare")


def test_what_a_robots_file_shows_are_its_parts(tmp_path):
    scene = bench(load(str(write_bench(tmp_path))))
    assert set(scene.parts) == {"arm", "floor", "desk", "calib_board", "parcel", "tin"} and shows(scene)
    assert scene.things == ("calib_board", "parcel", "tin") and scene.joints == scene.nominal.joints
    assert not (scene.goal or scene.held or scene.fixture)
    for arm in (write_mjcf(tmp_path), write_urdf(tmp_path), "iiwa14"):
        assert not shows(bench(load(str(arm)))), arm


def standing(file: Path) -> tuple[str, ...]:
    """Asserts that the cameras of a robot's file stand where MuJoCo has them, and returns their names."""
    robot = load(str(file))
    cameras, model = cameras_of(robot), robot.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = HOME
    mujoco.mj_forward(model, data)
    geometry = Geometry(bench(robot), cameras)
    geometry.at(HOME)
    for camera in cameras:
        pos, turn = geometry.pose(camera.name)
        row = model.camera(camera.name).id
        assert np.allclose(pos, data.cam_xpos[row], atol=1e-9), camera
        assert np.allclose(turn @ np.diag([1, -1, -1]), data.cam_xmat[row].reshape(3, 3), atol=1e-9), camera
    return tuple(c.name for c in cameras)


def test_its_cameras_stand_where_the_file_has_them(tmp_path):
    file = write_bench(tmp_path)
    assert sorted(standing(file)) == [EYE, "tripod"]
    assert {c.name: c.parent for c in cameras_of(load(str(file)))} == {EYE: "flange", "tripod": "base"}


@pytest.mark.parametrize(
    ("body", "site"),
    [
        ("fore", "fore"),  # a site called like its body
        ("base", "elbow"),  # a body that moves, called `base`
    ],
)
def test_a_camera_stands_where_the_file_has_it_whatever_its_frames_are_called(tmp_path, body, site):
    file = write_bench(tmp_path)
    inside = f'<site name="{site}" pos="0.1 0.2 0.3" euler="0.1 0.2 0.3"/><camera name="elbow" pos="0.1 0 0.1" '
    inside += 'euler="0.3 0.2 0.1" resolution="64 48"/>'
    text = file.read_text().replace('<body name="fore" pos="0 0 0.3">', f'<body name="{body}" pos="0 0 0.3">{inside}')
    file.write_text(text)
    assert sorted(standing(file)) == ["elbow", EYE, "tripod"]


def test_a_camera_that_cannot_be_does_not_take_the_others_along(tmp_path):
    file = write_bench(tmp_path)
    wide = '<camera name="wide" pos="0 0 2" fovy="178" resolution="64 48"/>'
    file.write_text(file.read_text().replace("<worldbody>", f"<worldbody>{wide}"))
    assert sorted(c.name for c in cameras_of(load(str(file)))) == [EYE, "tripod"]


@pytest.mark.parametrize(("projection", "seen"), [("perspective", ("above",)), ("orthographic", ())])
def test_a_camera_without_perspective_is_left_out(tmp_path, projection, seen):
    """Its `fovy` is a length, so it has no focal length in px."""
    camera = f'<camera name="above" pos="0 0 2" projection="{projection}" fovy="1.5" resolution="64 48"/>'
    path = write_mjcf(tmp_path)
    path.write_text(path.read_text().replace("<worldbody>", f"<worldbody>{camera}"))
    assert tuple(c.name for c in cameras_of(load(str(path)))) == seen


def test_angles_and_pictures_alone_are_compared_and_checked(tmp_path):
    log = bare(tmp_path, recorded(tmp_path, "a", 0.3, fps=0.8))
    (tmp_path / "found.yaml").write_text(FOUND)
    nominal, right = (compare(tmp_path / name, log).record for name in ("lab.xml", "found.yaml"))
    off = [r["pictures"]["cameras"][0]["border_median_px"] for r in (nominal, right)]
    assert off[0] > 1.0 and off[1] < 0.25
    assert nominal["ladder"][0]["unit"] == "px RMS" and mistakes(ComparisonRecord, nominal) == []
    assert "noise floor" not in str(compare(tmp_path / "lab.xml", log)), "nothing is known of it"
    made = check([log], out=tmp_path / "checked")
    for said in (str(made), (tmp_path / "checked" / "report.html").read_text()):
        assert "can show errors of their cameras" not in said, "they can: the file shows what stands about the robot"
    checked = made.record["recordings"][0]["cameras"][0]
    assert checked["mount"] == "flange" and checked["coverage"] > 0.3
    assert compare(tmp_path / "lab.xml", log).save(tmp_path / "compared").joinpath("report.html").is_file()


@pytest.mark.parametrize(
    ("robot", "cell", "said"),
    [
        ("lab.xml", "nominal", "the robot has a part named 'floor'"),
        ("lab.xml", "{robot: iiwa14}", "the cell belongs to another robot"),
        ("iiwa14", "{robot: {tool: none}}", "nothing holds the peg"),
        ("iiwa14", "{world: bench, task: {friction: 0.2}}", "is of a task's cell"),
    ],
)
def test_a_cell_that_cannot_hold_the_robot_is_refused_in_one_line(tmp_path, robot, cell, said):
    write_bench(tmp_path)
    (tmp_path / "model.yaml").write_text(MODEL.format(robot=robot, cell=cell))
    with pytest.raises(UserError, match=said) as refused:
        read_model(str(tmp_path / "model.yaml"))
    assert "\n" not in str(refused.value)


def test_a_cell_has_the_models_robot(tmp_path):
    write_bench(tmp_path)
    arm = (tmp_path / "lab.xml").read_text()
    for part in ("floor", "desk"):
        arm = arm.replace(f'name="{part}"', f'name="my_{part}"')
    (tmp_path / "arm.xml").write_text(arm)
    (tmp_path / "model.yaml").write_text(MODEL.format(robot="arm.xml", cell="{task: {fixture: [0.45, 0.0, 0.05]}}"))
    scene = robot_of_world(read_model(str(tmp_path / "model.yaml")))
    assert scene.joints == ("waist", "shoulder", "elbow", "roll", "pitch", "twist") and scene.goal == "hole"


@pytest.mark.slow
@pytest.mark.timeout(1800)  # several diagnoses of pictures
def test_a_cameras_error_is_named_and_fitted(tmp_path):
    first, other = (bare(tmp_path, recorded(tmp_path, n, p, fps=2.0)) for n, p in (("a", 0.3), ("b", 1.1)))
    found = vispeg.diagnose(tmp_path / "lab.xml", first, other)
    assert found.verdict == "identified" and [e.effect for e in found.effects] == ["camera_offset"]
    fitted = fit(tmp_path / "lab.xml", first, [f"camera_offset:{EYE}"], other)
    for result in (found, fitted):
        (placed,) = result.effects
        assert placed.where == EYE and abs(placed.params["x"].value - 0.006) < 4e-4
    json.dumps(fitted.record)


@pytest.mark.slow
@pytest.mark.timeout(1800)  # several diagnoses of pictures
def test_a_killed_diagnosis_of_joints_and_pictures_goes_on(tmp_path):
    both = recorded(tmp_path, "a", 0.3), recorded(tmp_path, "b", 1.1)
    resumed(tmp_path / "lab.xml", both, tmp_path, "looking for what is left")
