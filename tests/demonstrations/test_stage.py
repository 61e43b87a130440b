"""What `vispeg render` draws is what the task itself shows; looks differ, states do not; order does not matter."""

import hashlib
import resource
from dataclasses import replace

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.datasets.codec import decode, encode
from vispeg.datasets.layout import is_picture, truth_of
from vispeg.datasets.shards.plan import Shard, look_seed
from vispeg.datasets.shards.shard import shard_bytes
from vispeg.demonstrations.plan import images_of, plan_of
from vispeg.demonstrations.stage import ROWS, Stage, shard
from vispeg.task.world_file import load_world
from vispeg.worlds.split import optical

CAMERAS = ("wrist_wide", "external")


@pytest.fixture(scope="module")
def asked():
    return plan_of("S", 8, looks=2, cameras=CAMERAS, size=24, seed=5)


@pytest.fixture(scope="module")
def episodes(asked):
    plan, layout = asked
    return list(shard(plan, layout, Shard(0, 0, 8)))


def pictures(episode, name):
    found = episode.values[name]
    return found if isinstance(found, np.ndarray) else np.stack([decode(b) for b in found])


def test_a_shard_has_its_frames_and_both_looks(asked, episodes):
    plan, layout = asked
    assert sum(map(len, episodes)) == 8 and set(episodes[0].values) == set(layout.features)
    assert [e.about["look"] for e in episodes[:2]] == [0, 1] and layout.fps == 6.25
    assert all(e.about["seed"] == plan.episode_seed(0, 0) for e in episodes[:2])
    assert [c["name"] for c in episodes[0].about["cameras"]] == list(CAMERAS)


def test_labels_change_no_picture(asked, episodes):
    plan, layout = plan_of("S", 8, looks=2, cameras=CAMERAS, size=24, seed=5, labels=False)
    for labelled, bare in zip(episodes, shard(plan, layout, Shard(0, 0, 8)), strict=True):
        for name in bare.values:
            pairs = zip(labelled.values[name], bare.values[name], strict=True)
            assert all(np.array_equal(a, b) for a, b in pairs), name


def test_looks_share_states_and_physics_and_nothing_that_is_seen(asked, episodes):
    first, second = episodes[:2]
    n = min(len(first), len(second))
    for name, feature in asked[1].features.items():
        if not is_picture(feature) and not name.startswith(("label.camera", "label.peg")):
            assert np.array_equal(first.values[name][:n], second.values[name][:n]), name
    assert not np.array_equal(
        pictures(first, "observation.images.external")[0], pictures(second, "observation.images.external")[0]
    )
    differ = {k for k in first.about["world"] if first.about["world"].get(k) != second.about["world"].get(k)}
    assert differ and not any(k.startswith(("link_mass", "contact", "viscous", "payload")) for k in differ)


@pytest.fixture
def rolling(tmp_path):
    """A world in which the wrist's camera reads its rows one after another."""
    path = tmp_path / "rolling.yaml"
    effects = "effects:\n- {effect: rolling_shutter, where: wrist_wide, params: {readout: 0.08}}\n"
    path.write_text(f"format: vispeg-world/1\nbase: unknown_hole\n{effects}")
    return str(path)


def test_a_rolling_shutter_shears_what_moves_before_the_camera_and_nothing_that_is_carried_with_it(rolling):
    made = []
    for world in ("unknown_hole", rolling):
        plan, layout = plan_of(world, 6, cameras=("wrist_wide",), size=48, seed=3)
        made.append(next(iter(shard(plan, layout, Shard(0, 0, 6)))))
    still, sheared = (pictures(episode, "observation.images.wrist_wide").astype(int) for episode in made)
    parts = [pictures(episode, "label.parts.wrist_wide") for episode in made]
    gripper = parts[0] == 1 + layout.parts.index("gripper")
    np.testing.assert_array_equal(gripper, parts[1] == 1 + layout.parts.index("gripper"))
    np.testing.assert_array_equal(sheared[gripper], still[gripper])
    assert 0.1 < gripper.mean() < 0.5 and np.abs(sheared - still)[~gripper].max() > 20


@pytest.mark.parametrize("world", ["unknown_hole", "N", "rolling"])  # N: depth by block matching
def test_the_first_look_is_what_the_task_shows(world, rolling):
    from vispeg.task.peg.task import PegInHoleVec

    world = rolling if world == "rolling" else world
    plan, layout = plan_of(world, 8, cameras=CAMERAS, size=24, noise=0.0)
    seeds = [plan.episode_seed(0, i) for i in range(ROWS)]
    stage = Stage(plan, layout)
    made = stage.draw(stage.play(seeds, 1000)[2], 0, 3)
    stage.close()
    how = {"cameras": CAMERAS, "image_size": 24, "measured": True, "privileged": True}
    env = PegInHoleVec(ROWS, world, obs_mode="rgbd", **how)
    seen = env.reset(seed=seeds[2])[0]  # row 0 plays it; the expert's actions are those that were recorded
    for step in range(3):
        for name in CAMERAS:
            rgb = np.moveaxis(seen[f"rgb_{name}"][0], 0, -1)
            # another place in the batch may round otherwise, so a pixel at an edge may differ by a level
            off = np.abs(rgb.astype(int) - pictures(made, f"observation.images.{name}")[step])
            assert (off > 1).mean() < 0.005, (name, step)
            depth = seen[f"depth_{name}"][0, 0]
            away = np.abs(depth - pictures(made, f"observation.depth.{name}")[step])
            assert np.median(away) < 1e-6 and (away > 1e-4).mean() < 0.01
        want = made.values["observation.policy"][step]
        assert np.allclose(want, seen["policy"][0], atol=2e-4)
        assert np.allclose(made.values[truth_of(())][step], seen["privileged"][0], rtol=1e-3, atol=1e-3)
        assert np.allclose(made.values["observation.state"][step], seen["measured"][0], rtol=1e-4, atol=1e-5)
        action = np.zeros((ROWS, 3))
        action[0] = made.values["executed.action"][step]
        seen = env.step(action)[0]
    env.close()


def test_poses_of_labels_put_the_peg_where_it_is_drawn(asked, episodes):
    from vispeg.datasets.formats.bop import matrix
    from vispeg.render.cameras.camera import Camera

    part = 1 + asked[1].parts.index("peg")
    tried = 0
    for e in episodes:
        cameras = {c["name"]: Camera(**c) for c in e.about["cameras"]}
        for i in range(len(e)):
            view = np.linalg.inv(matrix(e.values["label.camera.wrist_wide"][i]))
            # a point of the peg's skin towards the camera, above the tip
            peg = matrix(e.values["label.peg.wrist_wide"][i])
            eye = np.linalg.inv(view)[:3, 3]
            axis = np.linalg.inv(matrix(e.values["label.peg.wrist_wide"][i]))[:3, :3] @ (eye - peg[:3, 3])
            toward = np.array([axis[0], axis[1], 0]) / np.hypot(axis[0], axis[1])
            up = 1.0 if axis[2] > 0 else -1.0
            point = view @ peg @ np.append(0.0079 * toward + [0, 0, 0.008 * up], 1)
            x, y = np.round(cameras["wrist_wide"].project(point[:3])).astype(int)
            labels = pictures(e, "label.parts.wrist_wide")[i]
            if 1 <= x < 23 and 1 <= y < 23:
                tried += 1
                assert part in labels[y - 1 : y + 2, x - 1 : x + 2]
    assert tried >= 4


def test_a_stage_that_has_made_other_shards_makes_the_same_bytes(asked):
    plan, layout = replace(asked[0], frames=8, shard_frames=4), asked[1]
    a, b = plan.shards
    fresh = [hashlib.sha256(shard_bytes(shard, plan, layout, s)).digest() for s in (a, b)]
    again = [hashlib.sha256(shard_bytes(shard, plan, layout, s)).digest() for s in (b, a)]
    assert fresh == again[::-1]


def test_memory_stays_flat(asked):
    plan, layout = asked
    sizes = []
    for number in range(4):
        for _ in shard(plan, layout, Shard(number, 0, 2)):
            pass
        sizes.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    assert sizes[-1] - sizes[1] < 15, sizes  # MB


def test_first_look_has_the_episodes_own_seed():
    assert look_seed(7, 0) == 7 and len({look_seed(7, k) for k in range(50)}) == 50


def test_effects_of_other_cameras_are_left_out():
    world = load_world("S").world
    labels = {r.label for r in optical(world, ("external",)).ranges}
    assert "camera_offset(each)" in labels and not any(label.startswith("link_mass") for label in labels)


@pytest.mark.parametrize(
    ("given", "words"),
    [({"cameras": ("wirst",)}, "unknown camera"), ({"cameras": ("external", "external")}, "cameras")],
)
def test_unknown_cameras_are_told(given, words):
    with pytest.raises(UserError, match=words):
        plan_of("nominal", 10, **given)


def test_a_world_that_changed_since_is_refused(asked):
    plan, layout = asked
    with pytest.raises(UserError, match="has changed"):
        Stage(replace(plan, world_hash="1" * 64), layout)


def test_images_of_looks_are_part_of_the_plan_and_must_be_the_same_where_it_is_drawn(monkeypatch, tmp_path):
    """Else a rendering that is continued, or a node, would mix the images of two folders."""
    for folder, grey in (("a", 200), ("b", 100)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "x.png").write_bytes(encode(np.full((8, 8, 3), grey, np.uint8)))
    assert len({(tmp_path / folder / "x.png").stat().st_size for folder in "ab"}) == 1
    world = tmp_path / "world.yaml"
    world.write_text(
        "format: vispeg-world/1\nbase: nominal\neffects:\n"
        "- {effect: image_texture, where: table, params: {amount: 1, pick: {uniform: [0, 1]}}}\n"
    )
    monkeypatch.setenv("VISPEG_TEXTURES", str(tmp_path / "a"))
    plan, layout = plan_of(str(world), 8, cameras=CAMERAS, size=24)
    monkeypatch.setenv("VISPEG_TEXTURES", str(tmp_path / "b"))
    others = images_of(load_world(world), CAMERAS)
    assert plan.images != others
    assert plan_of(str(world), 8, cameras=CAMERAS, size=24)[0] == replace(plan, images=others)
    with pytest.raises(UserError, match="VISPEG_TEXTURES as then"):
        Stage(plan, layout)
    assert plan_of("nominal", 8)[0].images == ""
