"""A board beside the fixture: its corners are readings like borders, and a board that is bent is no effect's doing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from vispeg.api.inputs import Inputs
from vispeg.api.recording.look import cameras_of, look_of, scene_of
from vispeg.channels.channel import CHANNELS, How
from vispeg.channels.pictures import border_evidence_of
from vispeg.core.effect import EffectInstance
from vispeg.identify.motions.look_motion import look_motion
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.frames.frames import Frames
from vispeg.recordings.recording import Control, Recording
from vispeg.render.calibration.board import Board
from vispeg.view.diagnose.borders import Borders
from vispeg.vision.board_picture import with_board
from vispeg.vision.geometry import Geometry
from vispeg.vision.photograph import photograph
from vispeg.worlds.world import World

CELL = World("iiwa14", "meg50+peg16", cell=CellBelief("nominal"))
STATED = {"kind": "chessboard", "columns": 5, "rows": 4, "square": 0.02}
POSE = np.diag([1.0, -1.0, -1.0, 1.0])
POSE[:3, 3] = 0.47, 0.14, 0.003  # beside the fixture, on the table
WRIST, SCENE = "wrist_wide", scene_of(CELL)


def pictured(seed: int, *effects: EffectInstance, bend: float = 0.0, frames: int = 8) -> Recording:
    """A recording of a cell with a board, whose middle stands out by `bend` m."""
    cameras = cameras_of([WRIST], SCENE, (320, 240))
    motion = look_motion("look", SCENE, 100.0, 16.0)
    curve = CubicSpline(motion.time, motion.q_cmd if seed % 2 else motion.q_cmd[::-1])
    world = CELL.add(*effects, *look_of(f"S/{seed}", SCENE))
    geometry, out = Geometry(SCENE, cameras), []
    geometry.place(world)
    shots = photograph(SCENE, cameras, world, curve, np.linspace(2.5, 15.0, frames), seed)
    for shot in shots:
        geometry.at(curve(shot.time))
        place = geometry.eyes[WRIST], geometry.pose(WRIST), Board(**STATED), POSE
        rgb, depth = with_board(shot.rgb, shot.depth, *place, lambda x, y: bend * (1 - ((x - 0.04) / 0.05) ** 2))
        out.append(replace(shot, rgb_source=rgb, depth_source=depth))
    time = np.arange(0.0, 16.0, 0.01)
    rec = Recording(Path(f"board-{seed}"), "iiwa14", SCENE.joints, 100.0, Control(), time, curve(time))
    return replace(rec, frames=Frames(shots.cameras, tuple(out)), cell=CellBelief("nominal", board=STATED))


@pytest.mark.slow
def test_corners_are_readings_that_the_truth_leaves_little_of():
    hidden = EffectInstance.of("camera_offset", WRIST, x=0.004)
    evidence, _ = border_evidence_of(CELL, [pictured(3, hidden, frames=6)], [])
    (item,) = evidence.items
    corners = (item.points.parts[:, 0] > len(SCENE.parts)) & item.valid[:, 0]
    assert corners.sum() > 100
    (at_truth,), (nominal,) = evidence.misplaced(CELL.add(hidden)), evidence.misplaced(CELL)
    assert np.sqrt(np.mean(at_truth[corners] ** 2)) < 0.15
    assert np.sqrt(np.mean(nominal[corners] ** 2)) > 1.0


@pytest.mark.slow
def test_pictures_of_recordings_of_one_name_keep_their_own_recording():
    """Both are called `rig`, and each item's frames have times of their own recording."""
    first, second = (replace(pictured(3, frames=6), path=Path(day, "rig")) for day in ("monday", "tuesday"))
    shots = tuple(replace(frame, time=frame.time + 50.0) for frame in second.frames)
    second = replace(second, time=second.time + 50.0, frames=replace(second.frames, frames=shots))
    shown = Borders(Inputs(CELL, (first, second), (), ({}, {}), ()), 1, lambda text: None, None)
    for track, rec in enumerate((first, second)):
        got, start = shown.recorded(track)
        assert got is rec and start == rec.time[0]
    before, after = shown.tracks(CELL, CELL)
    np.testing.assert_allclose(after.time, before.time)


@pytest.mark.slow
def test_an_offset_is_named_with_a_board_in_sight():
    hidden = EffectInstance.of("camera_offset", WRIST, x=0.004)
    result = CHANNELS["pictures"].diagnose(CELL, ([pictured(3, hidden)], [pictured(4, hidden)]), How())
    (placed,) = result.world.effects
    assert result.record["verdict"] == "identified" and placed.effect == "camera_offset"
    assert placed.params["x"].low <= 0.004 <= placed.params["x"].high


@pytest.mark.slow
def test_a_bent_board_is_unexplained():
    record = CHANNELS["pictures"].diagnose(CELL, ([pictured(3, bend=0.006)], [pictured(4, bend=0.006)]), How()).record
    assert record["verdict"] == "unexplained" and not record["effects"]
    assert record["unexplained"]["depends_on"][0]["input"] == "the board's shape"
