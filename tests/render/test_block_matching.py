"""A stereo camera that computes its depth: planes of known distance, and the shadow that a near thing casts."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.render.backends.backend import Renderer
from vispeg.render.block_matching import Matcher, depth, eyes, settings
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.standard import standard_cameras
from vispeg.render.look import dress
from vispeg.robots.scene import build
from vispeg.worlds.world import World

F, SIZE = 42.0, 32
EYE = Camera("eye", SIZE, SIZE, F, F, 15.5, 15.5)  # in the world's origin, looking along z
P = {k: q.start for k, q in effect("block_matching").params.items()}


def wall(z: float, post: float | None = None, camera: Camera = EYE, x: float = 0.0) -> Renderer:
    """A grey wall at z m and, at `post` m and x m, a post as high as the image whose near face is 8 px wide."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=(3, 3, 0.01), pos=(0, 0, z + 0.01), rgba=(0.6, 0.6, 0.6, 1)
    )
    if post is not None:
        half = 4 * post / F
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=(half, 3, 0.001), pos=(x, 0, post + 0.001), rgba=(0.4, 0.4, 0.4, 1)
        )
    return Renderer(spec.compile(), [camera], backend="raycast")


@pytest.mark.parametrize("z", [0.2, 0.4, 0.8])
def test_a_plane_is_as_far_as_it_is_to_a_part_of_a_pixel(z):
    """Systematic errors below a quarter of a pixel of disparity, scatter below a third: in depth, z^2 / (f B) of it."""
    with wall(z) as renderer:
        seen = depth(renderer, "eye", P, stream(0, "plane"))
    fb = F * round(P["focal"] / F) * P["baseline"]
    assert (seen > 0).mean() > 0.98
    d = fb / seen[seen > 0].astype(float)
    assert abs(np.median(d) - fb / z) < 0.25 and d.std() < 0.33


def test_a_near_post_casts_a_shadow_to_its_left():
    """About f B (1 / z_near - 1 / z_far) px of the image are lost beside it, none on the other side."""
    near, far, baseline = 0.25, 0.6, 0.08
    with wall(far, near) as renderer:
        seen = depth(renderer, "eye", P | {"baseline": baseline}, stream(0, "post"))
    rows = seen[4:-4]
    post = np.abs(rows - near) < 0.02
    assert post[:, 13:19].mean() > 0.9 and np.abs(rows[:, 24:] - far).max() < 0.1
    width = F * baseline * (1 / near - 1 / far)  # 7.8 px, less what the window smears over it
    lost = (rows == 0).sum(axis=1)
    assert 0.4 * width < np.median(lost) < 1.3 * width
    assert (rows[:, :14] == 0).sum() > 5 * (rows[:, 18:] == 0).sum()


def test_matched_depth_is_that_of_the_cameras_own_lens():
    """A post near the edge, which the lens moves inwards by 2.6 px, is in the columns of the rendered depth."""
    camera = Camera("eye", 96, 24, F, F, 47.5, 11.5, distortion=(-0.08, 0, 0, 0, 0))
    with wall(0.6, 0.3, camera, x=0.3 * 38 / F) as renderer:
        rendered = renderer.render()["eye"].depth
        seen = depth(renderer, "eye", P, stream(0, "lens"))
    assert seen.shape == rendered.shape
    found, true = (np.flatnonzero((np.abs(z - 0.3) < 0.03).mean(axis=0) > 0.5) for z in (seen, rendered))
    assert len(true) and np.abs(found[[0, -1]] - true[[0, -1]]).max() <= 1


def test_eyes_drawn_apart_sit_where_each_look_moved_the_camera():
    scene = build()
    camera = next(c for c in standard_cameras(scene.tip, scene.target) if c.name == "external")
    on = EffectInstance.of("block_matching", "external", on=1.0)
    with Renderer(scene, [camera], "raycast") as renderer:
        matcher = Matcher(renderer, scene, "filament")
        for x in (0.03, 0.0, -0.05):
            world = World().add(on, EffectInstance.of("camera_offset", "external", x=x))
            dress(renderer, scene, world)
            matcher.begin(world, {})
            assert np.linalg.norm(np.subtract(renderer.cameras[0].pos, camera.pos)) == pytest.approx(abs(x))
            assert matcher._eyes is not None and matcher._eyes.cameras == renderer.cameras
        matcher.close()


def test_the_eyes_see_the_cameras_pixels():
    """A pixel's centre is its block's centre, and the second eye is beside the first by the baseline."""
    left, right, span = eyes(EYE, 5, 0.05, 0.1)
    assert span % 16 == 0 and span >= left.fx * 0.05 / 0.1
    point = np.array([[0.05, -0.02, 0.4]])
    u, v = EYE.project(point)[0]
    fine = left.project(point)[0]
    np.testing.assert_allclose([(fine[0] - span + 0.5) / 5 - 0.5, (fine[1] + 0.5) / 5 - 0.5], [u, v], atol=1e-9)
    shifted = right.project(point - [[0.05, 0, 0]])[0]
    np.testing.assert_allclose(fine - shifted, [left.fx * 0.05 / 0.4, 0], atol=1e-9)


def test_same_seed_same_bytes_and_the_renderer_is_left_as_it_was():
    with wall(0.4) as renderer:
        before = renderer.render()["eye"]
        first = depth(renderer, "eye", P, stream(3, "again"))
        second = depth(renderer, "eye", P, stream(3, "again"))
        other = depth(renderer, "eye", P | {"seed": 5.0}, stream(3, "again"))
        after = renderer.render()["eye"]
        with pytest.raises(UserError, match="eye"):
            depth(renderer, "ear", P, stream(0, "x"))
    assert np.array_equal(first, second) and not np.array_equal(first, other)
    assert np.array_equal(before.depth, after.depth) and np.array_equal(before.rgb, after.rgb)
    assert renderer.cameras == (EYE,) == renderer.nominal


def test_a_world_says_whether_depth_is_matched():
    on = EffectInstance.of("block_matching", "wrist", on=1.0, baseline=0.018)
    assert settings(World(), "wrist") is None
    assert settings(World().add(EffectInstance.of("block_matching", "wrist")), "wrist") is None
    found = settings(World().add(on), "wrist")
    assert found is not None and found["baseline"] == 0.018 and settings(World().add(on), "external") is None
