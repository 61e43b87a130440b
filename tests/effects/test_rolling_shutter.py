"""A rolling shutter moves each row by what the camera's motion moves the picture in the time until it is read."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vispeg.core.effect import effect
from vispeg.core.frame import Frame
from vispeg.effects.common.image_motion import arriving, image_flow
from vispeg.render.backends.backend import Renderer
from vispeg.render.cameras.standard import standard_cameras
from vispeg.robots.scene import build
from vispeg.task.eyes import resized
from vispeg.task.start import home

K = np.array([[100.0, 0, 40], [0, 110, 30], [0, 0, 1]])
TWIST = np.array([0.2, -0.1, 0.15, 0.3, -0.4, 0.5])


def frame(rgb: np.ndarray, depth: np.ndarray) -> Frame:
    return Frame(rgb[None], depth[None].copy(), K[None], depth[None], velocity=TWIST[None], time=np.zeros(1))


def test_flow_is_the_derivative_of_the_projection():
    depth = np.random.default_rng(0).uniform(0.2, 0.5, (60, 80)).astype(np.float32)
    flow = image_flow(frame(np.zeros((60, 80, 3), np.float32), depth), 0, 1 / depth)
    v, u = np.mgrid[:60, :80]
    points = np.stack([(u - 40) / 100 * depth, (v - 30) / 110 * depth, depth], -1).reshape(-1, 3).astype(float)
    dt = 1e-5
    moved = Rotation.from_rotvec(-TWIST[3:] * dt).apply(points - TWIST[:3] * dt)
    seen = np.hstack([moved[:, :2] / moved[:, 2:] * [100, 110] + [40, 30], moved[:, 2:]])
    speed = (seen.reshape(60, 80, 3) - np.stack([u, v, depth], -1)) / dt
    for axis in range(3):
        assert np.abs(speed - flow)[..., axis].max() < 0.01 * np.abs(flow[..., axis]).max()


def test_the_middle_row_stays_and_rows_lean_both_ways():
    u = np.arange(80.0)
    ramp = np.repeat(np.tile(u / 80, (61, 1))[..., None], 3, -1).astype(np.float32)
    depth = np.full((61, 80), 0.4, np.float32)
    f = frame(ramp.copy(), depth)
    f.velocity[:] = [[0.2, 0, 0, 0, 0, 0]]
    effect("rolling_shutter").image({}, f, {"readout": np.array([0.04])}, [])
    shift = (f.rgb[0] - ramp)[:, 40, 0] * 80  # px: what was to the left, where the picture moves right
    expected = 0.2 / 0.4 * 100 * 0.04 * (np.arange(61) / 60 - 0.5)
    assert np.allclose(shift, expected, atol=0.02)
    assert abs(shift[30]) < 1e-4


def test_the_nearer_of_two_that_arrive_is_seen_and_what_is_left_shows_what_was_beside_it():
    """A near bar of three pixels before a wall: it moves by three, or the wall does, which then shows what it did."""
    near = np.full((1, 12), 1.0, np.float32)
    near[0, 4:7] = 2.0
    bar = np.where(near > 1, 3.0, 0.0)[..., None] * [1.0, 0, 0]
    assert np.array_equal(arriving(bar.astype(np.float32), near)[0, :, 0], [0, 0, 0, 0, 3, 3, 3, 3, 3, 3, 0, 0])
    wall = (3.0 - bar[..., :1]) * [1.0, 0, 0]
    assert np.array_equal(arriving(wall.astype(np.float32), near)[0, :, 0], [3, 3, 3, 3, 0, 0, 0, 0, 0, 0, 3, 3])


@pytest.mark.parametrize("camera", ["wrist_wide", "external"])
def test_it_is_what_a_camera_sees_that_reads_row_after_row_of_a_moving_arm(camera):
    """Each row drawn at its own time, and one picture sheared. The gripper does not move before its own camera."""
    scene, readout = build(), 0.06
    (eye,) = (resized(c, 90) for c in standard_cameras(scene.tip, scene.config.fixture) if c.name == camera)
    late = readout * (np.arange(eye.height) / (eye.height - 1) - 0.5)
    with Renderer(scene, [eye], "raycast", labels=True, moving=True) as renderer:
        model, posture = renderer.model, home(scene)
        qpos, qvel = (np.zeros(n) for n in (model.nq, model.nv))
        qpos[: len(posture)], qvel[:7] = posture, (0.6, -0.4, 0.5, 0.3, 0.2, 0.8, 1.0)
        shot, rows = renderer.render(qpos, qvel=qvel)[camera], []
        assert shot.segmentation is not None and shot.bodies is not None and shot.twists is not None
        for i, t in enumerate(late):
            then = qpos.copy()
            mujoco.mj_integratePos(model, then, qvel, t)
            drawn = renderer.render(then)[camera]
            assert drawn.segmentation is not None
            rows.append([drawn.rgb[i] / 255, drawn.depth[i], drawn.segmentation[i]])
    colour, depth, parts = (np.stack(images) for images in zip(*rows, strict=True))
    rgb, seen, label = shot.rgb / np.float32(255), shot.depth.copy(), shot.segmentation.astype(np.uint8)
    still = rgb.copy()

    def off() -> np.ndarray:
        return np.array([np.mean(label != parts), np.mean(np.abs(rgb - colour)), np.mean(np.abs(seen - depth) > 0.003)])

    before = off()
    moved = {"velocity": shot.velocity[None], "bodies": shot.bodies[None], "twists": shot.twists[None]}
    given = Frame(rgb[None], seen[None], eye.K[None], shot.depth[None], parts=label[None], **moved)
    effect("rolling_shutter").image({}, given, {"readout": np.array([readout])}, [])
    assert np.all(off() < 0.75 * before), (before, off())
    carried = (shot.twists[shot.bodies] == 0).all(-1)
    if camera == "wrist_wide":
        assert 0.05 < carried.mean() < 0.5
        np.testing.assert_array_equal(rgb[carried], still[carried])
