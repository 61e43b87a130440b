"""What policies see: the same physics whatever is seen, one row as many, looks that come and go with episodes."""

from dataclasses import replace

import numpy as np
import pytest

import vispeg
from vispeg.api.recording.look import cameras_of
from vispeg.core.errors import UserError
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import save_cameras
from vispeg.task.environments.env import TaskEnv
from vispeg.task.eyes import task_cameras
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.task import PegInHoleVec, PegTask
from vispeg.worlds.distribution import Uniform
from vispeg.worlds.randomized import RandomizedEffect, RandomizedWorld

WORLD = RandomizedWorld(
    ranges=(
        RandomizedEffect("hole_offset", "fixture", {"x": Uniform(-0.03, 0.03)}),
        RandomizedEffect("part_colour", "each", {"amount": 1.0, "hue": Uniform(0, 1), "saturation": 0.8, "value": 0.7}),
        RandomizedEffect("disparity_noise", "all", {"sd": Uniform(0.05, 0.2)}),
        RandomizedEffect("brightness", "all", {"change": Uniform(-0.3, 0.3)}),
    )
)
SMALL = {"image_size": 16, "steps": 4, "backend": "raycast"}  # needs no graphics driver


def test_seeing_changes_no_physics():
    """State, depth and colour of one seed move alike, bit by bit; and depth is that beside colour."""
    dark = RandomizedEffect("grazing_holes", "all", {"dark": 1.0, "shine": 1.0})
    moving = RandomizedEffect("motion_blur", "all", {"exposure": 0.1})
    world, runs, seen = replace(WORLD, ranges=(*WORLD.ranges, dark, moving)), [], {}
    for mode in ("state", "depth", "rgb", "rgbd"):
        env = PegInHoleVec(2, world=world, obs_mode=mode, **SMALL)
        env.reset(seed=6)
        for _ in range(3):
            seen[mode] = env.step(np.full((2, 3), -0.4))[0]
        runs.append(env.sim.cell.qpos.copy())
        env.close()
    assert all(np.array_equal(runs[0], other) for other in runs[1:])
    for key, images in seen["rgbd"].items():
        for mode in ("depth", "rgb"):
            if key.startswith(f"{mode}_"):
                assert np.array_equal(images, seen[mode][key]), key


def test_one_row_sees_what_it_sees_among_many():
    """Images too, over an episode's end."""
    many = PegInHoleVec(2, world=WORLD, obs_mode="rgbd", autoreset_mode="SameStep", **SMALL)
    one = PegInHoleVec(1, world=WORLD, obs_mode="rgbd", autoreset_mode="SameStep", **SMALL)
    a, b = many.reset(seed=1)[0], one.reset(seed=2)[0]
    for _ in range(6):
        for key in a:
            assert np.array_equal(a[key][1], b[key][0]), key
        a, b = many.step(np.full((2, 3), 0.3))[0], one.step(np.full((1, 3), 0.3))[0]


def test_a_row_that_begins_anew_shows_the_others_no_moment_twice():
    """With cameras that remember: latency, lost frames, errors that last."""
    slow = (
        RandomizedEffect("camera_delay", "all", {"delay": Uniform(0.1, 0.3)}),
        RandomizedEffect("dropped_frames", "all", {"chance": 0.3}),
    )
    lasting = RandomizedEffect("depth_temporal", "all", {"sd": 0.2, "rho": 0.8, "length": 1.0})
    world = RandomizedWorld(ranges=(*WORLD.ranges, *slow, lasting))
    calm, busy = (
        PegInHoleVec(3, world=world, obs_mode="rgbd", autoreset_mode="Disabled", **SMALL | {"steps": 9})
        for _ in range(2)
    )
    for env in (calm, busy):
        env.reset(seed=[4, 5, 6])
    for k in range(6):
        if k in (2, 3):
            busy.reset(seed=[70 + k] * 3, options={"reset_mask": np.array([False, True, False])})
        action = np.full((3, 3), 0.3 - 0.1 * k)
        a, b = calm.step(action)[0], busy.step(action)[0]
        for key in a:
            assert np.array_equal(a[key][[0, 2]], b[key][[0, 2]]), (k, key)
            assert k < 2 or not np.array_equal(a[key][1], b[key][1])


def test_images_keep_their_spaces_and_their_units():
    """Types and shapes as announced; depth of the near fixture is a few tenths of a metre."""
    env = PegInHoleVec(1, world="nominal", obs_mode="rgbd", **SMALL)
    obs, _ = env.reset(seed=0)
    assert env.observation_space.contains(obs)
    wide = obs["depth_wrist_wide"][0, 0]
    assert wide.dtype == np.float32 and 0.1 < np.median(wide[wide > 0]) < 0.6
    assert obs["rgb_wrist_wide"].dtype == np.uint8 and obs["rgb_wrist_wide"].std() > 5


def test_looks_change_between_episodes_and_only_then():
    """The first image of two episodes differs in colour; within an episode the look stays."""
    env = PegInHoleVec(1, world=WORLD, obs_mode="rgb", **SMALL)
    first = env.reset(seed=0)[0]["rgb_wrist_wide"].astype(float)
    still = env.step(np.zeros((1, 3)))[0]["rgb_wrist_wide"].astype(float)
    other = env.reset(seed=1)[0]["rgb_wrist_wide"].astype(float)
    moved, changed = np.abs(still - first).mean(), np.abs(other - first).mean()
    assert changed > 3 * moved


def test_the_hole_is_seen_where_it_is():
    """Two holes 40 mm apart give different depth images of the same start: the information is in the pixels."""
    images = []
    for x in (-0.02, 0.02):
        world = RandomizedWorld(ranges=(RandomizedEffect("hole_offset", "fixture", {"x": x}),))
        images.append(PegInHoleVec(1, world=world, obs_mode="depth", **SMALL).reset(seed=4)[0])
    a, b = images
    assert np.array_equal(a["policy"], b["policy"])
    assert (np.abs(a["depth_wrist_wide"] - b["depth_wrist_wide"]) > 0.005).sum() > 5


def test_wrong_cameras_and_modes_are_refused():
    """With what there is to choose from."""
    with pytest.raises(UserError, match="wrist_wide"):
        PegInHoleVec(1, world="nominal", obs_mode="depth", cameras=("wrist_left",))
    with pytest.raises(UserError, match="rgbd"):
        PegInHoleVec(1, world="nominal", obs_mode="thermal")
    with pytest.raises(UserError, match="image_size"):
        PegInHoleVec(1, world="nominal", obs_mode="depth", image_size=3)


def test_cameras_of_a_world_are_the_same_in_any_order():
    config = PegConfig(cameras=("external", "side"))
    scene = PegTask().cell(config)
    stated = {"external": {"fx": 300.0}, "side": {"fy": 250.0}}
    forth, back = (task_cameras(scene, config, dict(some)) for some in (stated.items(), [*stated.items()][::-1]))
    assert [c.K.tolist() for c in forth] == [c.K.tolist() for c in back]


def test_cameras_are_told_calibrated_and_as_drawn():
    """By the camera as it is drawn, the block's top is found where it stands; by the calibrated one, 5 mm aside."""
    off = RandomizedEffect("camera_offset", "wrist_wide", {"x": 0.004, "y": -0.003})
    seen = {"cameras": ("wrist_wide",), "image_size": 96, "backend": "raycast"}
    drawn, plain = (TaskEnv(RandomizedWorld(r), "depth", **seen) for r in ((off,), ()))
    (camera,) = drawn.cameras
    first, nominal = drawn.reset(seed=3), plain.reset(seed=3)[1]["cameras"]["wrist_wide"]
    moved = first[1]["cameras"]["wrist_wide"]["base_T_camera"] - nominal["base_T_camera"]
    assert np.linalg.norm(moved[:3, 3]) == pytest.approx(0.005, abs=1e-4)

    def reach(depth: np.ndarray, view) -> float:
        """Furthest point (m) of the block's round top from its middle, by this view."""
        goal, pose = drawn.vec.sim.cell.site_position("goal")[0], view["base_T_camera"]
        points = camera.points(depth[0]) @ pose[:3, :3].T + pose[:3, 3]
        top = (depth[0] > 0) & (np.abs(points[..., 2] - goal[2]) < 0.004)
        assert top.sum() > 200
        return float(np.linalg.norm(points[top][:, :2] - goal[:2], axis=1).max())

    assert reach(first[0]["depth_wrist_wide"], nominal) > 0.052
    for obs, *_, info in (first, drawn.step(np.array([0.2, -0.1, -0.1]))):
        view = info["cameras"]["wrist_wide"]
        np.testing.assert_allclose(view["K"], camera.K, rtol=1e-6)
        assert 0.048 < reach(obs["depth_wrist_wide"], view) < 0.0505


def test_depth_as_an_image_keeps_what_is_missing_and_two_millimetres():
    """0 where nothing was read; elsewhere the metres within a level, up to where it saturates."""
    a, b = (vispeg.make("S", "depth", depth_image=image, **SMALL) for image in (False, True))
    metres, grey = (env.reset(seed=4)[0]["depth_wrist_wide"] for env in (a, b))
    assert grey.dtype == np.uint8 and b.observation_space["depth_wrist_wide"].dtype == np.uint8
    assert np.array_equal(grey == 0, metres == 0) and b.observation_space["depth_wrist_wide"].shape == grey.shape
    near = (metres > 0) & (metres < 0.5)
    assert near.any() and np.abs(0.002 * grey[near].astype(float) - metres[near]).max() <= 0.001 + 1e-6
    assert set(grey[metres >= 0.51].tolist()) <= {255}


def test_a_camera_file_without_a_pose_leaves_the_camera_in_its_place(tmp_path):
    """A calibration without poses knows a lens, not where the camera is; a world and a recording say that."""
    config = PegConfig(cameras=("wrist_wide",), image_size=0)
    cell = PegTask().cell(config)
    (usual,) = task_cameras(cell, config, {})
    lens = Camera("camera", 64, 40, 50.0, 51.0, 31.0, 20.0, (0.1, -0.05, 1e-3, 1e-3, 0.0))
    placed = lens.moved(name="wrist_wide", parent=usual.parent, pos=usual.pos, quat=usual.quat)
    for style in ("vispeg", "ros", "opencv"):
        file = str(save_cameras(tmp_path / f"{style}.yaml", lens, style=style, posed=False))
        assert task_cameras(cell, config, {"wrist_wide": file}) == (placed,)
        with pytest.raises(UserError, match="does not state where the camera 'mine' is"):
            task_cameras(cell, config, {"mine": file})
        with pytest.raises(UserError, match="does not state where the camera 'camera' is"):
            cameras_of([file], cell, (320, 240))
    file = str(save_cameras(tmp_path / "named.yaml", lens.moved(name="wrist_wide"), posed=False))
    assert cameras_of([file], cell, (320, 240)) == (placed,)
    file = str(save_cameras(tmp_path / "posed.yaml", lens))
    assert task_cameras(cell, config, {"wrist_wide": file}) == (lens.moved(name="wrist_wide"),)
