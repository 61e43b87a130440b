"""A camera that sees nothing of the cell is said to, and left out; where none sees anything, nothing is diagnosed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import vispeg
from vispeg.api.recording.look import cameras_of, scene_of
from vispeg.channels.channel import CHANNELS, How
from vispeg.channels.pictures import border_evidence_of
from vispeg.core.errors import UserError
from vispeg.diagnosis.pictures.coverage import excitations
from vispeg.identify.motions.look_motion import look_motion
from vispeg.identify.pictures.build import border_evidence, seeing
from vispeg.identify.pictures.read import sights_of
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.recording import Control, Recording
from vispeg.vision.check import check_frames, warnings_of
from vispeg.vision.photograph import photograph
from vispeg.worlds.world import World

CELL = World("iiwa14", "meg50+peg16", cell=CellBelief("nominal"))
SCENE = scene_of(CELL)
PICTURES = CHANNELS["pictures"]
TIMES = np.linspace(1.0, 15.0, 7)  # s, of the frames
(HAND,) = (c.moved(name="my hand") for c in cameras_of(["wrist_wide"], SCENE, (80, 60)))
SKY = HAND.moved(name="sky", parent="base", pos=(0.0, 0.0, 3.0), quat=(1.0, 0.0, 0.0, 0.0))  # looks up
FLOOR = HAND.moved(name="floor", parent="base", pos=(0.6, 0.35, 0.4), quat=(0.0, 1.0, 0.0, 0.0), fx=400.0, fy=400.0)


def seen_by(*cameras, seed: int = 0, times: np.ndarray = TIMES) -> Recording:
    motion = look_motion("look", SCENE, 100.0, 16.0)
    q = motion.q_cmd if seed % 2 else motion.q_cmd[::-1]
    shots = photograph(SCENE, cameras, CELL, CubicSpline(motion.time, q), times, seed, finer=1)
    rec = Recording(Path(f"run-{seed}"), "iiwa14", SCENE.joints, 100.0, Control(), motion.time, q)
    return replace(rec, frames=shots, cell=CELL.cell)


def test_a_camera_that_sees_nothing_is_said_and_left_out():
    groups = tuple(sights_of([seen_by(HAND, SKY, seed=k)]) for k in (0, 1))
    left, (note,) = seeing(SCENE, groups, CELL)
    assert [[s.camera.name for s in some] for some in left] == [["my hand"]] * 2
    assert note.startswith("camera 'sky' is left out: ")


def test_where_no_camera_sees_anything_nothing_is_diagnosed_and_check_says_why():
    one, other = (seen_by(SKY, seed=k) for k in (0, 1))
    for attempt in (
        lambda: PICTURES.diagnose(CELL, ([one], [other]), How()),
        lambda: border_evidence_of(CELL, [one], [other]),
    ):
        with pytest.raises(UserError, match="no camera sees the cell: camera 'sky'"):
            attempt()
    assert excitations(SCENE, one, CELL) == []
    (checked,) = check_frames(one, SCENE)
    assert any("shows no border of the cell" in line for line in warnings_of(checked))


def test_frames_at_the_ends_of_the_log_are_left_out_as_no_delay_could_be_found_with_them():
    rec = seen_by(HAND, times=np.linspace(0.0, 16.0, 9))
    (sight,) = sights_of([rec])
    assert sight.time.tolist() == np.linspace(2.0, 14.0, 7).tolist()
    evidence, _ = border_evidence(SCENE, [sight], [], CELL)
    assert 0 < evidence.errors([CELL])[0] < 0.3  # px


def test_two_calibrations_of_one_camera_are_refused_where_they_are_compared():
    one, other = seen_by(HAND, seed=0), seen_by(HAND.moved(fx=HAND.fx * 1.01), seed=1)
    for attempt in (
        lambda: PICTURES.diagnose(CELL, ([one], [other]), How()),
        lambda: PICTURES.blind(CELL, ([one, other], [])),
        lambda: border_evidence_of(CELL, [one, other], []),
    ):
        with pytest.raises(UserError, match="camera 'my hand' has another calibration than in recording 'run-0'"):
            attempt()


def test_a_camera_that_sees_a_surface_and_no_border_stays_for_its_depth():
    rec = seen_by(HAND, FLOOR)
    sights = sights_of([rec])
    assert seeing(SCENE, (sights,), CELL) == ((sights,), [])
    evidence, _ = border_evidence(SCENE, sights, [], CELL, 0.0)
    assert len(evidence.items[1].points.frame) == 0 and np.isfinite(evidence.errors([CELL])[0])


PENDULUM = """<mujoco model="pendulum">
  <worldbody>
    <light pos="0 0 3"/><geom name="floor" type="plane" size="3 3 .1" pos="0 0 -1"/>
    <body name="arm"><joint name="swing" axis="0 1 0" range="-1 1"/>
      <inertial pos="0 0 .2" mass="2" diaginertia=".02 .02 .01"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 .4"/>
      <camera name="up" pos="0 0 .5" euler="180 0 0" fovy="30" resolution="64 48"/></body>
  </worldbody>
  <actuator><motor joint="swing" ctrlrange="-40 40"/></actuator>
</mujoco>
"""


def test_joints_are_diagnosed_where_pictures_show_nothing_and_a_note_says_so(tmp_path):
    (tmp_path / "pendulum.xml").write_text(PENDULUM)
    model = str(tmp_path / "pendulum.xml")
    hidden = "coulomb_friction:swing:torque=0.8"
    for k, name in enumerate("ab"):
        made = vispeg.record(model, "fourier", cameras=["up"], effects=hidden, rate_hz=200.0, duration=3.0, seed=k)
        made.save(tmp_path / name)
    found = vispeg.diagnose(model, tmp_path / "a", tmp_path / "b")
    assert [e.effect for e in found.effects] == ["coulomb_friction"]
    (said,) = found.record["missing"]
    assert said.startswith("pictures are left out: no camera sees the cell: camera 'up'")
    assert sum(said in str(block) for block in found.summary) == 1, "once in the terminal"
    with pytest.raises(UserError, match="no camera sees the cell"):
        vispeg.diagnose(model, tmp_path / "a", tmp_path / "b", channels=["pictures"])


def test_pictures_without_colour_are_refused_for_edges_are_found_in_it():
    rec = seen_by(HAND)
    assert rec.frames is not None
    deep = replace(rec.frames, frames=tuple(replace(f, rgb_source=None) for f in rec.frames))
    with pytest.raises(UserError, match="no colour"):
        PICTURES.diagnose(CELL, ([rec], [replace(rec, frames=deep)]), How())
