"""The pipeline: order, streams of its own for every effect, rows that change worlds; and the sensors that it is fed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camera_images import busy, plane

from vispeg.core.effect import EffectInstance, effect, of_family
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.robots.scene import build
from vispeg.task.world_file import load_world
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.sensor import sensor, sensor_file, sensors
from vispeg.worlds.world import World


def started(*names: str) -> World:
    """These effects at every camera, at their start values."""
    return World().add(
        *(EffectInstance.of(n, "all", **{k: q.start for k, q in effect(n).params.items()}) for n in names)
    )


def run(world: World, camera: str = "wrist_wide", frame=None, seed: int = 0):
    frame = frame or busy(1)
    return Pipeline([world] * frame.n, camera).run(frame, [stream(seed, "run", i) for i in range(frame.n)])


def test_effects_act_in_their_order_whatever_the_worlds():
    """Limits before noise, optics before the sensor, the sensor before the picture, the picture before the cable."""
    names = sorted(of_family("camera"))
    forwards = Pipeline([started(*names)], "c")
    backwards = Pipeline([started(*reversed(names))], "c")
    acting = [s.effect.name for s in forwards.stages]
    assert acting == [s.effect.name for s in backwards.stages]
    chain = ["stereo_shadow", "edge_fattening", "disparity_noise", "disparity_quantization", "lens_distortion"]
    chain += ["blur", "exposure", "rgb_noise", "white_balance", "jpeg", "dropped_frames", "camera_delay"]
    assert [n for n in acting if n in chain] == chain


def test_one_effect_more_leaves_the_draws_of_the_others():
    alone = run(started("disparity_noise", "rgb_noise"), frame=plane(0.3))
    more = run(started("disparity_noise", "rgb_noise", "motion_blur", "jpeg"), frame=plane(0.3))
    np.testing.assert_array_equal(alone.depth, more.depth)
    fewer = run(started("rgb_noise"), frame=plane(0.3))
    np.testing.assert_array_equal(alone.rgb, fewer.rgb)
    again = run(started("rgb_noise"), frame=plane(0.3), seed=1)
    assert not np.array_equal(alone.rgb, again.rgb)


def test_several_effects_on_light_in_one_pass_are_the_same_one_by_one():
    """Up to rounding of the encoding in between, where nothing is cut."""
    world = started("vignetting", "blur", "exposure")
    together = run(world, frame=plane(0.3)).rgb
    frame = plane(0.3)
    for name in ("blur", "vignetting", "exposure"):
        frame = run(started(name), frame=frame)
    np.testing.assert_allclose(together, frame.rgb, atol=3e-5)


def test_effects_of_another_camera_stay_away():
    world = World().add(EffectInstance.of("brightness", "external", change=0.3))
    np.testing.assert_array_equal(run(world, "wrist_wide").rgb, busy(1).rgb)
    assert not np.array_equal(run(world, "external").rgb, busy(1).rgb)
    nothing = World().add(EffectInstance.of("coulomb_friction", "joint1", torque=1.0))
    np.testing.assert_array_equal(run(nothing).depth, busy(1).depth)


def test_a_row_that_gets_a_new_world_leaves_the_others():
    a, b = (
        World().add(EffectInstance.of("brightness", "all", change=0.2)),
        World().add(EffectInstance.of("hue", "all", turn=0.2)),
    )
    pipeline = Pipeline([a, a], "c")
    pipeline.place([1], [b])
    out = pipeline.run(busy(2), [stream(i, "row") for i in range(2)])
    np.testing.assert_array_equal(out.rgb[:1], run(a).rgb)
    np.testing.assert_array_equal(out.rgb[1:], run(b, frame=busy(2)).rgb[1:])
    pipeline.place([0, 1], [World(), World()])
    assert pipeline.stages == []


@pytest.mark.parametrize("name", sorted(n for n in of_family("camera") if effect(n).overrides("image")))
def test_images_that_do_not_pass_stay_as_rendered_and_are_not_remembered(name):
    moments = [replace(busy(2), time=np.full(2, 0.16 * k)) for k in range(3)]
    flipped = replace(moments[1], rgb=moments[1].rgb[:, ::-1].copy(), depth=moments[1].depth[:, ::-1].copy())

    def drawn(k):
        return [stream(k, "row", i) for i in range(2)]

    plain, disturbed = Pipeline([started(name)] * 2, "c"), Pipeline([started(name)] * 2, "c")
    for k in (0, 1):
        first, second = (p.run(moments[k], drawn(k)) for p in (plain, disturbed))
    beside = disturbed.run(flipped, drawn(7), np.array([False, True]))
    np.testing.assert_array_equal(beside.rgb[0], flipped.rgb[0])
    np.testing.assert_array_equal(beside.depth[0], flipped.depth[0])
    first, second = (p.run(moments[2], drawn(2)) for p in (plain, disturbed))
    np.testing.assert_array_equal(first.rgb[0], second.rgb[0])
    np.testing.assert_array_equal(first.depth[0], second.depth[0])


def test_mistakes_are_said():
    with pytest.raises(UserError, match="d435"):
        sensor("d453")
    with pytest.raises(ValueError, match="2 worlds, 1 images"):
        Pipeline([World(), World()], "c").run(busy(1), [stream(0, "x")])


@pytest.mark.parametrize("name", sensors())
def test_a_sensor_is_a_world_that_cites_its_figures(name):
    """As a world file, checked against every bound; each range says where it is from."""
    ranges = sensor(name)
    assert ranges == load_world(sensor_file(name)).world.ranges
    assert all(r.source for r in ranges)
    moved = sensor(name, "wrist_wide")
    assert {r.where for r in moved} == {"wrist_wide"} and [r.params for r in moved] == [r.params for r in ranges]


@pytest.mark.parametrize(
    ("name", "z", "most"), [("d405", 0.2, 0.004), ("d435", 0.3, 0.006), ("structured_light", 0.5, 0.010)]
)
def test_a_sensor_at_its_working_distance_sees_a_plane(name, z, most):
    """Most readings are there and within a few millimetres; nearer than its limit there is none."""
    scene, errors, holes = build(), [], []
    world = RandomizedWorld(ranges=sensor(name, "external"))
    for seed in range(12):
        pipeline = Pipeline([world.sample(seed, scene)], "external")
        seen = pipeline.run(plane(z), [stream(seed, "plane")]).depth
        holes.append((seen == 0).mean())
        errors.append(np.abs(seen[seen > 0] - z).mean())
        assert not Pipeline([world.sample(seed, scene)], "external").run(plane(0.05), [stream(0, "near")]).depth.any()
    assert np.mean(holes) < 0.1 and 1e-4 < np.mean(errors) < most
