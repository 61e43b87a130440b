"""Over an exposure each pixel is smeared by the motion of what it shows: the gripper is sharp before its own camera."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.frame import Frame
from vispeg.effects.common.light import to_linear, to_srgb
from vispeg.render.backends.backend import Renderer
from vispeg.render.cameras.standard import standard_cameras
from vispeg.robots.scene import build
from vispeg.task.eyes import resized
from vispeg.task.start import home
from vispeg.worlds.distribution import Uniform
from vispeg.worlds.randomized import RandomizedEffect, RandomizedWorld
from vispeg.worlds.split import moving
from vispeg.worlds.world import World

NONE = {"length": np.zeros(1), "angle": np.zeros(1)}


@pytest.mark.parametrize("camera", ["wrist_wide", "external"])
def test_it_is_the_mean_of_what_is_drawn_while_the_shutter_is_open(camera):
    scene, exposure, speed = build(), 0.03, (0.6, -0.4, 0.5, 0.3, 0.2, 0.8, 1.0)
    (eye,) = (resized(c, 90) for c in standard_cameras(scene.tip, scene.config.fixture) if c.name == camera)
    with Renderer(scene, [eye], "raycast", moving=True) as renderer:
        model, posture = renderer.model, home(scene)
        qpos, qvel = (np.zeros(n) for n in (model.nq, model.nv))
        qpos[: len(posture)], qvel[:7] = posture, speed
        shot, looks = renderer.render(qpos, qvel=qvel)[camera], []
        for t in exposure * ((np.arange(15) + 0.5) / 15 - 0.5):
            then = qpos.copy()
            mujoco.mj_integratePos(model, then, qvel, t)
            looks.append(to_linear(renderer.render(then)[camera].rgb.astype(np.float32) / 255))
    assert shot.bodies is not None and shot.twists is not None
    true, still = to_srgb(np.mean(looks, axis=0)), shot.rgb / np.float32(255)
    motion = {"velocity": shot.velocity[None], "bodies": shot.bodies[None], "twists": shot.twists[None]}
    frame = Frame(still[None].copy(), shot.depth[None], eye.K[None], shot.depth[None], **motion)
    effect("motion_blur").image({}, frame, {**NONE, "exposure": np.array([exposure])}, [])
    assert frame.rgb is not None
    moves = (shot.twists[shot.bodies] != 0).any(-1)
    off, before = (np.abs(rgb - true)[moves].mean() for rgb in (frame.rgb[0], still))
    assert off < 0.6 * before, (off, before)
    if camera == "wrist_wide":
        assert 0.05 < np.mean(~moves) < 0.5
        np.testing.assert_allclose(frame.rgb[0][~moves], still[~moves], atol=1e-6)


def test_bodies_are_drawn_only_where_something_is_smeared_by_its_motion():
    """They cost a segmentation of each picture."""
    assert not moving(World(effects=(EffectInstance.of("motion_blur", "all", length=3.0, exposure=0.0),)))
    assert moving(World(effects=(EffectInstance.of("motion_blur", "all", length=0.0, exposure=0.01),)))
    for params, needed in (({"length": 3.0}, False), ({"exposure": Uniform(0.0, 0.02)}, True)):
        assert moving(RandomizedWorld(ranges=(RandomizedEffect("motion_blur", "all", params),))) is needed
    assert moving(RandomizedWorld(ranges=(RandomizedEffect("rolling_shutter", "all", {"readout": 0.02}),)))
