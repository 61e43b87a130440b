"""The laws of what a camera does in time: errors that last, frames that are lost, frames that come late."""

from __future__ import annotations

import numpy as np
from camera_images import plane

from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.worlds.world import World

FB = 425.0 * 0.05  # px m


def episode(name: str, count: int, step: float = 0.1, n: int = 1, **values: float) -> list[np.ndarray]:
    """Depth (n, 64, 64) of each frame delivered; the k-th frame shows a plane at 1 + k m."""
    pipeline = Pipeline([World().add(EffectInstance.of(name, "all", **values))] * n, "wrist")
    rng = [stream(i, "time") for i in range(n)]
    out = []
    for k in range(count):
        frame = plane(1.0 + k, n)
        frame.time = np.full(n, k * step)
        out.append(pipeline.run(frame, rng).depth)
    return out


def shown(frames: list[np.ndarray]) -> list[int]:
    """Which rendered frame each delivered one is."""
    return [round(float(f.mean())) - 1 for f in frames]


def test_late_frames_are_the_ones_of_that_time():
    assert shown(episode("camera_delay", 6, delay=0.2)) == [0, 0, 0, 1, 2, 3]
    assert shown(episode("camera_delay", 6, delay=0.04)) == [0, 1, 2, 3, 4, 5]  # nearest in time
    assert shown(episode("camera_delay", 6, delay=0.05)) == [0, 0, 1, 2, 3, 4]  # as near: the earlier
    assert shown(episode("camera_delay", 6, step=0.02, delay=0.06)) == [0, 0, 0, 0, 1, 2]
    assert shown(episode("camera_delay", 4, delay=-0.1)) == [0, 1, 2, 3]  # nobody has a frame of what comes


def test_lost_frames_repeat_the_last_one_delivered():
    frames = shown(episode("dropped_frames", 2000, chance=0.3))
    lost = np.diff(frames) == 0
    assert frames[0] == 0 and abs(lost.mean() - 0.3) < 0.03
    for k in range(1, len(frames)):
        assert frames[k] in (k, frames[k - 1])
    assert abs(np.mean(lost[1:] & lost[:-1]) - 0.09) < 0.02  # independent


def test_lasting_errors_are_an_autoregression():
    """Stationary from the first frame on, correlated by rho^k over k frames."""
    pipeline = Pipeline([World().add(EffectInstance.of("depth_temporal", "all", sd=0.2, rho=0.8))] * 40, "wrist")
    rng = [stream(i, "ar") for i in range(40)]
    errors = []
    for k in range(8):
        frame = plane(0.5, 40)
        frame.time = np.full(40, 0.1 * k)
        errors.append(FB / pipeline.run(frame, rng).depth.astype(float) - FB / 0.5)
    e = np.stack(errors)
    np.testing.assert_allclose(e.std(axis=(1, 2, 3)), 0.2, rtol=0.05)
    for lag in (1, 2, 4):
        assert abs(np.mean(e[lag:] * e[:-lag]) / 0.04 - 0.8**lag) < 0.05


def test_an_episode_forgets_the_one_before():
    """A time that goes back, or a world put in its place, begins a row anew; other rows go on."""
    world = World().add(EffectInstance.of("camera_delay", "all", delay=0.1))
    for how in ("time", "place"):
        pipeline = Pipeline([world, world], "wrist")
        rng = [stream(i, "forget") for i in range(2)]
        for k, times in enumerate(([0.0, 0.0], [0.1, 0.1], [0.0 if how == "time" else 0.2, 0.2])):
            if how == "place" and k == 2:
                pipeline.place([0], [world])
            frame = plane(1.0 + k, 2)
            frame.time = np.array(times)
            out = pipeline.run(frame, rng).depth
        assert out[0].mean() == 3.0 and out[1].mean() == 2.0
