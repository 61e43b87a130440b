"""The plant: another renderer, looks of its own, a sensor that the library does not have, and a robot that errs.

The hidden effects are made by the library's own code, since they are to be named. All else is not: the softness and
noise of the pictures, the depth steps and lost edges of the sensor, and a smooth error of the robot's path.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from cases import CAMERA, Case
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from vispeg.api.recording.look import cameras_of, look_of, scene_of
from vispeg.core.effect import EffectInstance
from vispeg.identify.motions.look_motion import look_motion
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.recordings.recording import Control, Recording
from vispeg.render.calibration.board import Board
from vispeg.sim.compiled import nominal_of
from vispeg.sim.reach import reach
from vispeg.vision.board_picture import with_board
from vispeg.vision.geometry import Geometry
from vispeg.vision.photograph import photograph
from vispeg.worlds.world import World

CELL = World("iiwa14", "meg50+peg16", cell=CellBelief("nominal"))
SIZE, SECONDS, RATE = (320, 240), 16.0, 200.0
LEVER = 0.8  # m/rad, position error of the flange over the error of a joint
SLOW = 0.4  # s between the knots of the robot's error
DISPARITY = 0.05 * 425 / 1e-2  # px m: baseline times focal length over the smallest step that the sensor tells apart
BEND = np.radians(1.5)
BOARD = {"kind": "chessboard", "columns": 5, "rows": 4, "square": 0.02}
BULGE = 0.006  # m that the board's middle stands out by
LAID = np.diag([1.0, -1.0, -1.0, 1.0])
LAID[:3, 3] = 0.47, 0.14, 0.003  # m: on the table beside the fixture


def recording(case: Case, part: int, frames: int, backend: str) -> Recording:
    """Return a recording of a case; part 0 is to fit, 1 to judge on: another direction, speed, look and noise."""
    rng = np.random.default_rng([case.seed, part])
    scene = scene_of(CELL)
    cameras = cameras_of([CAMERA], scene, SIZE)
    motion = look_motion(case.motion, scene, RATE, SECONDS if part == 0 else 1.15 * SECONDS)
    q = motion.q_cmd if part == 0 else motion.q_cmd[::-1]
    time = motion.time
    knots = np.arange(time[0], time[-1] + 2 * SLOW, SLOW)
    errors = CubicSpline(knots, rng.normal(size=(len(knots), q.shape[1])) * case.robot / LEVER)(time)
    true = q + errors
    if case.unknown == "bent_flange":
        true = _bent(scene, true)
    effects = [EffectInstance.of(e, where, **dict(values)) for e, where, values in case.hidden]
    if case.unknown == "moved_fixture":
        effects.append(EffectInstance.of("hole_offset", "fixture", x=0.008, y=-0.006, z=0.0))
    if case.unknown == "tilted_fixture":
        effects.append(EffectInstance.of("hole_tilt", "fixture", roll=0.14, pitch=-0.1))
    look = look_of(f"S/{500 + 2 * case.seed + part}", scene)
    stamps = np.linspace(1.0, time[-1] - 1.0, frames) + rng.uniform(-0.1, 0.1, frames)
    shots = photograph(
        scene, cameras, CELL.add(*look, *effects), CubicSpline(time, true), stamps, case.seed, backend=backend
    )
    cell = CELL.cell
    if case.unknown == "bent_board":
        cell = replace(CellBelief("nominal"), board=BOARD)
        shots = _with_board(scene, cameras, CELL.add(*effects), CubicSpline(time, true), shots)
    read = q.copy()
    for e in effects:
        if e.effect == "encoder_offset":
            read[:, scene.joints.index(e.where)] += e.params["offset"].value
    pictures = [_sensed(f, rng, case.unknown == "water_on_lens") for f in shots]
    label = Path(f"{case.name.replace('/', '-')}-{'ab'[part]}")
    rec = Recording(label, "iiwa14", scene.joints, RATE, Control(), time, read, cell=cell)
    return replace(rec, frames=Frames(shots.cameras, tuple(pictures)))


def _with_board(scene, cameras, world: World, path: CubicSpline, shots: Frames) -> Frames:
    """Return the pictures with a bent calibration board drawn into them."""
    geometry, out = Geometry(scene, cameras), []
    geometry.place(world)
    for frame in shots:
        assert frame.rgb is not None and frame.depth is not None
        geometry.at(path(frame.time))
        place = geometry.eyes[CAMERA], geometry.pose(CAMERA), Board(**BOARD), LAID
        rgb, depth = with_board(frame.rgb, frame.depth, *place, lambda x, y: BULGE * (1 - ((x - 0.04) / 0.05) ** 2))
        out.append(replace(frame, rgb_source=rgb, depth_source=depth))
    return Frames(shots.cameras, tuple(out))


def _sensed(frame: RecordedFrame, rng: np.random.Generator, wet: bool) -> RecordedFrame:
    """Return the picture of a sensor that no effect describes: soft, gamma-noisy; depth in steps with ragged edges."""
    import cv2

    rgb, depth = frame.rgb, frame.depth
    assert rgb is not None and depth is not None
    image = cv2.GaussianBlur(rgb.astype(np.float32), (0, 0), 0.35)
    image *= rng.gamma(6e3, 1 / 6e3, image.shape).astype(np.float32)
    image += rng.laplace(0, 0.8, image.shape).astype(np.float32)
    if wet:
        v, u = np.mgrid[: image.shape[0], : image.shape[1]].astype(np.float32)
        x, y = u - 0.68 * image.shape[1], v - 0.55 * image.shape[0]
        drop = np.exp(-(x * x + y * y) / (0.2 * image.shape[1]) ** 2)
        u, v = (u + 0.35 * x * drop).astype(np.float32), (v + 0.35 * y * drop).astype(np.float32)
        image = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    steps = np.where(depth > 0, np.rint(DISPARITY / np.maximum(depth, 1e-3)), 0)
    stepped = np.where(steps > 0, DISPARITY / np.maximum(steps, 1), 0).astype(np.float32)
    around = np.ones((3, 3), np.uint8)
    near = cv2.erode(np.where(depth > 0, depth, np.inf).astype(np.float32), around)
    ragged = cv2.dilate(depth, around) - near > 0.05  # an edge of a thing, not the rim of a hole
    stepped[ragged & (rng.random(depth.shape) < 0.3)] = 0
    return replace(frame, rgb_source=np.clip(np.rint(image), 0, 255).astype(np.uint8), depth_source=stepped)


def _bent(scene, q: np.ndarray) -> np.ndarray:
    """Return joint angles at which a straight flange has the pose of the bent one at q; camera and tool turn alike."""
    few = q[::20]  # interpolated below
    nominal = nominal_of(scene.nominal, len(few))
    _, _, pos, quat, _ = nominal.operational(few)
    turned = (Rotation.from_quat(quat[:, [1, 2, 3, 0]]) * Rotation.from_rotvec([BEND, 0, 0])).as_quat()[:, [3, 0, 1, 2]]
    answer, _ = reach(nominal, pos.copy(), turned, few)
    return CubicSpline(np.arange(len(q))[::20], answer)(np.arange(len(q)))
