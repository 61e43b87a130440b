"""Looks seen side by side are what each of them is by itself."""

from dataclasses import replace

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.demonstrations.sensing import Clip, sense
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.robots.scene import build
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.sensor import sensor
from vispeg.worlds.world import World

EYE = Camera("wrist_wide", 24, 20, 30.0, 30.0, 11.5, 9.5)
PERIOD = 0.16


def clips():
    """Seven clips of 1 to 6 pictures; an edge in depth and colour that wanders, and sensors that are not alike."""
    scene, out = build(), []
    world = RandomizedWorld(ranges=sensor("d435", "all"))
    for i, length in enumerate((3, 1, 6, 2, 5, 1, 4)):
        rgb, depth = np.full((length, 20, 24, 3), 60, np.uint8), np.full((length, 20, 24), 0.4, np.float32)
        for t in range(length):
            rgb[t, :, 6 + t + i :] = 190
            depth[t, :, 6 + t + i :] = 0.25
        out.append(Clip(world.sample(i, scene), 100 + i, rgb, depth, depth, np.full((length, 6), 0.01)))
    return out


def alone(clip):
    """The clip through a pipeline of its own, a picture at a time."""
    pipeline, rgb, depth = Pipeline([clip.world], EYE.name), [], []
    for t in range(len(clip)):
        shown = {"rgb": clip.rgb[t : t + 1].astype(np.float32) / 255, "depth": clip.depth[t : t + 1]}
        about = {"K": EYE.K[None], "velocity": clip.velocity[t : t + 1], "time": np.array([t * PERIOD])}
        seen = pipeline.run(Frame(**shown, **about), [stream(clip.seed, "image", EYE.name, t)])
        assert seen.rgb is not None and seen.depth is not None
        rgb.append(seen.rgb[0])
        depth.append(seen.depth[0])
    return np.stack(rgb), np.stack(depth)


@pytest.mark.parametrize("rows", [1, 3, 7, 20])
def test_a_clip_is_what_it_is_by_itself_whatever_is_beside_or_before_it(rows):
    given = clips()
    for clip, seen in zip(given, sense(EYE, given, PERIOD, rows), strict=True):
        (want_rgb, want_depth), rgb, depth = alone(clip), seen.rgb, seen.depth
        assert rgb.shape == clip.rgb.shape and rgb.dtype == np.uint8 and depth.dtype == np.float32
        # sums of another stack may round otherwise, by which a reading at a threshold may come or go
        assert np.abs(rgb - 255 * want_rgb).max() < 0.51 + 1e-3
        off = np.abs(depth - want_depth) > 1e-5
        assert off.mean() < 0.002


def test_the_sensors_did_something_and_clips_are_left_as_they_were():
    given, kept = clips(), clips()
    seen = sense(EYE, given, PERIOD, 3)
    assert all((s.depth == 0).any() and not np.array_equal(s.depth, c.depth) for c, s in zip(given, seen, strict=True))
    assert all(
        np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth, b.depth) for a, b in zip(given, kept, strict=True)
    )


def test_the_same_clips_give_the_same_bytes_and_none_give_none():
    first, second = (sense(EYE, clips(), PERIOD) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert a.rgb.tobytes() == b.rgb.tobytes() and a.depth.tobytes() == b.depth.tobytes()
    assert sense(EYE, [], PERIOD) == []


def test_clips_of_which_some_have_labels_and_no_rows_are_refused():
    """Else pixels and labels that nothing has written would be returned."""
    given = clips()
    parts = np.ones(given[0].depth.shape, np.uint8)
    for name, value in (("parts", parts), ("bodies", parts)):
        with pytest.raises(ValueError, match=f"some clips have {name} and others do not"):
            sense(EYE, [replace(given[0], **{name: value}), *given[1:]], PERIOD)
    with pytest.raises(ValueError, match="0 rows, expected at least 1"):
        sense(EYE, given, PERIOD, 0)


def test_what_a_late_picture_shows_is_told():
    """Colours that count the moments: the moment told is the one that is seen, however late it comes."""
    rgb = np.stack([np.full((20, 24, 3), 20 * t, np.uint8) for t in range(6)])
    depth = np.stack([np.full((20, 24), 0.2 + 0.01 * t, np.float32) for t in range(6)])
    late = EffectInstance.of("camera_delay", "all", delay=2 * PERIOD)
    lost = EffectInstance.of("dropped_frames", "all", chance=0.4)
    cases = [(), (late,), (lost,), (lost, late)]
    parts = np.stack([np.full((20, 24), t, np.uint8) for t in range(6)])
    given = [Clip(World(effects=e), 7 + i, rgb, depth, depth, np.zeros((6, 6)), parts) for i, e in enumerate(cases)]
    for seen in sense(EYE, given, PERIOD):
        assert (seen.rgb == rgb[seen.shown]).all() and (seen.depth == depth[seen.shown]).all()
        assert (seen.parts == parts[seen.shown]).all()
    assert [s.shown.tolist() for s in sense(EYE, given[:2], PERIOD)] == [[0, 1, 2, 3, 4, 5], [0, 0, 0, 1, 2, 3]]


@pytest.mark.parametrize(
    "bent",
    [
        EffectInstance.of("lens_distortion", "all", k1=-0.15, p1=0.01),
        EffectInstance.of("rolling_shutter", "all", readout=0.08),
    ],
    ids=lambda e: e.effect,
)
def test_labels_follow_the_pixels_through_lens_and_shutter(bent):
    """Depth counts the parts: wherever the camera delivers it, the label is that of the pixel."""
    parts = np.add.outer(np.arange(20) // 4, np.arange(24) // 4 * 5).astype(np.uint8)[None] + 1
    depth = parts.astype(np.float32) / 10
    velocity = np.array([[0.3, 0.2, 0.1, 0.5, -0.4, 1.0]])
    late = EffectInstance.of("camera_delay", "all", delay=PERIOD)
    clip = [np.repeat(x, 3, axis=0) for x in (depth, depth, velocity, parts)]
    rgb = np.zeros((3, 20, 24, 3), np.uint8)
    (seen,) = sense(EYE, [Clip(World(effects=(bent, late)), 3, rgb, *clip)], PERIOD)
    assert not np.array_equal(seen.parts, clip[3])
    assert np.array_equal(seen.parts, np.rint(10 * seen.depth).astype(np.uint8))
