"""What every effect of a camera promises, measured by walking the registry: a new file is tested by being there."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from camera_images import busy

from vispeg.core.effect import EffectInstance, of_family
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.robots.model import load
from vispeg.robots.scene import build
from vispeg.worlds.world import World

CAMERA = of_family("camera")
IMAGE = sorted(n for n, e in CAMERA.items() if e.overrides("image") or hasattr(e, "light"))
COLOUR_ONLY = {n for n in IMAGE if 50 <= CAMERA[n].order <= 70}
BOTH = {"rolling_shutter", "lens_distortion", "occlusion", "dropped_frames", "camera_delay"}
OFTEN = {"dropped_frames": {"chance": 0.5}}  # where the start value shows too seldom for a test


def world(name: str, **values: float) -> World:
    """The effect at every camera; what is not given is at its start."""
    full = {k: p.start for k, p in CAMERA[name].params.items()} | OFTEN.get(name, {}) | values
    return World().add(EffectInstance.of(name, "all", **full))


def frames(n: int, count: int = 5) -> list[Frame]:
    """The first frames of an episode, 0.1 s apart, with depth and colour that change."""
    out = [busy(n) for _ in range(count)]
    for i, frame in enumerate(out):
        frame.time = np.full(n, 0.1 * i)
        frame.rgb = np.roll(frame.rgb, i, axis=2)
        frame.depth = np.roll(frame.depth, i, axis=2)
    return out


def run(worlds: list[World], given: list[Frame], seeds: list[int] | None = None) -> list[Frame]:
    """The frames through one pipeline."""
    pipeline = Pipeline(worlds, "wrist")
    rng = [stream(s, "images") for s in (seeds or range(len(worlds)))]
    return [pipeline.run(f, rng) for f in given]


def same(a: Frame, b: Frame) -> bool:
    return np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth, b.depth)


@pytest.mark.parametrize("name", IMAGE)
def test_null_is_bit_identical(name):
    """Whatever its shape parameters; also as one image among others that have the effect."""
    params = CAMERA[name].params
    null = {k: 0.5 * (p.start + p.high) if p.shape else p.null for k, p in params.items()}
    given = frames(3)
    for out, frame in zip(run([world(name, **null)] * 3, given), given, strict=True):
        assert same(out, frame)
    mixed = run([world(name), world(name, **null), World()], given)
    for out, frame in zip(mixed, given, strict=True):
        np.testing.assert_array_equal(out.rgb[1:], frame.rgb[1:])
        np.testing.assert_array_equal(out.depth[1:], frame.depth[1:])
    assert not all(map(same, mixed, given)), "the effect at its start value does nothing"
    kind, frame = CAMERA[name], busy(2)
    p = {k: np.full(2, v) for k, v in null.items()}
    kind.image({}, frame, p, [stream(i, "null") for i in range(2)])  # the hook itself, without a pipeline
    assert same(frame, busy(2))


@pytest.mark.parametrize("name", IMAGE)
def test_only_its_own_images_and_nothing_given(name):
    """Colour effects leave depth, depth effects leave colour; K, truth and the caller's arrays never change."""
    given = frames(2)
    kept = deepcopy(given)
    out = run([world(name)] * 2, given)
    for a, b, o in zip(given, kept, out, strict=True):
        assert same(a, b) and np.array_equal(a.K, b.K) and np.array_equal(o.K, b.K) and o.truth is b.truth
        assert o.rgb.dtype == o.depth.dtype == np.float32
    pairs = list(zip(out, kept, strict=True))
    changed = {k for k in ("rgb", "depth") if any(not np.array_equal(getattr(a, k), getattr(b, k)) for a, b in pairs)}
    assert changed == ({"rgb"} if name in COLOUR_ONLY else {"rgb", "depth"} if name in BOTH else {"depth"})


@pytest.mark.parametrize("name", IMAGE)
def test_valid_at_every_bound(name):
    """At each bound of each parameter: colours in [0, 1], depth finite and never below 0, nothing seen in nothing."""
    params = CAMERA[name].params
    worlds = [world(name, **{k: bound}) for k, p in params.items() for bound in (p.low, p.high)]
    strongest = {k: (p.low if abs(p.low - p.null) > abs(p.high - p.null) else p.high) for k, p in params.items()}
    worlds.append(world(name, **{k: v for k, v in strongest.items() if not params[k].shape}))
    given = frames(len(worlds))
    for out in run(worlds, given):
        assert np.isfinite(out.rgb).all() and out.rgb.min() >= 0 and out.rgb.max() <= 1
        assert np.isfinite(out.depth).all() and out.depth.min() >= 0 and out.depth.max() < 100
    if name not in BOTH | {"edge_fattening", "lateral_jitter"}:  # these move readings to other pixels
        assert (run(worlds, given)[0].depth[:, :6, :6] == 0).all()


@pytest.mark.parametrize("name", IMAGE)
def test_an_image_depends_on_its_own_seed_and_world_only(name):
    """The same bytes again, alone or among others, on a size that no vector instruction divides."""
    others = [world("disparity_noise"), world(name), world(name), world("rgb_noise")]
    given = frames(4)
    together = run(others, given, [5, 7, 8, 9])
    again = run(others, given, [5, 7, 8, 9])
    alone = [Frame(f.rgb[1:2], f.depth[1:2], f.K[1:2], velocity=f.velocity[1:2], time=f.time[1:2]) for f in given]
    for a, b, c in zip(together, again, run([world(name)], alone, [7]), strict=True):
        assert same(a, b)
        np.testing.assert_array_equal(a.rgb[1:2], c.rgb)
        np.testing.assert_array_equal(a.depth[1:2], c.depth)


@pytest.mark.parametrize("name", IMAGE)
def test_what_is_drawn_anew_on_a_smooth_surface_is_said_to_be_random(name):
    """A comparison of pictures predicts the others. There is no edge here, so chance at edges alone does not count."""
    depth = np.repeat(np.linspace(0.2, 0.4, 64, dtype=np.float32)[None, None], 60, axis=1)
    rgb, K = np.full((1, 60, 64, 3), 0.4, np.float32), busy(1).K
    given = [
        Frame(rgb + np.float32(0.1 * i), depth + np.float32(0.01 * i), K, velocity=np.ones((1, 6)), time=np.full(1, i))
        for i in range(5)
    ]
    own = [{"seed": float(s)} if "seed" in CAMERA[name].params else {} for s in (1, 2)]
    one, other = (run([world(name, **p)], given, [s]) for s, p in enumerate(own, 1))
    assert CAMERA[name].random is not all(map(same, one, other))


@pytest.mark.parametrize("name", IMAGE)
def test_colour_or_depth_alone(name):
    """A camera that gives only one of the two is no mistake, and gives that one as beside the other."""
    given = frames(1)
    both = run([world(name)], given)
    for lacking, other in (("rgb", "depth"), ("depth", "rgb")):
        cut = deepcopy(given)
        for frame in cut:
            frame.truth, frame.colour = frame.depth, frame.rgb  # what was rendered is known, delivered or not
            setattr(frame, lacking, None)
        alone = run([world(name)], cut)
        assert all(getattr(out, lacking) is None for out in alone)
        for one, beside in zip(alone, both, strict=True):
            np.testing.assert_array_equal(getattr(one, other), getattr(beside, other))
            assert one.colour is not None and one.truth is not None
        bare = [replace(frame, truth=None, colour=None) for frame in cut]
        assert all(getattr(out, lacking) is None for out in run([world(name)], bare))


@pytest.mark.parametrize("name", sorted(CAMERA))
def test_stated_well(name):
    kind = CAMERA[name]
    for key, p in kind.params.items():
        assert p.shape or (p.low <= p.null <= p.high and p.start != p.null), key
        assert p.unit and p.doc and (p.scale == "linear" or p.low > 0), key
    assert kind.magnitudes and type(kind).__doc__
    assert kind.targets(load("iiwa14")) == []
    assert kind.targets(build()) == list(build().cameras)
