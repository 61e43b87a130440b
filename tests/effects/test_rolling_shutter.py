"""A rolling shutter moves each row by what the camera's motion moves the picture in the time until it is read."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.core.effect import effect
from vispeg.core.frame import Frame
from vispeg.effects.camera.timing.rolling_shutter import image_flow

K = np.array([[100.0, 0, 40], [0, 110, 30], [0, 0, 1]])
TWIST = np.array([0.2, -0.1, 0.15, 0.3, -0.4, 0.5])


def frame(rgb: np.ndarray, depth: np.ndarray) -> Frame:
    return Frame(rgb[None], depth[None].copy(), K[None], depth[None], velocity=TWIST[None], time=np.zeros(1))


def test_flow_is_the_derivative_of_the_projection():
    depth = np.random.default_rng(0).uniform(0.2, 0.5, (60, 80)).astype(np.float32)
    flow = image_flow(frame(np.zeros((60, 80, 3), np.float32), depth), 0)
    v, u = np.mgrid[:60, :80]
    points = np.stack([(u - 40) / 100 * depth, (v - 30) / 110 * depth, depth], -1).reshape(-1, 3).astype(float)
    dt = 1e-5
    moved = Rotation.from_rotvec(-TWIST[3:] * dt).apply(points - TWIST[:3] * dt)
    seen = moved[:, :2] / moved[:, 2:] * [100, 110] + [40, 30]
    speed = (seen.reshape(60, 80, 2) - np.stack([u, v], -1)) / dt
    assert np.abs(speed - flow).max() < 0.01 * np.abs(flow).max()


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
