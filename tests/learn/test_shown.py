"""Demonstrations read from a dataset are its successful episodes' own frames, in its order."""

from dataclasses import replace

import numpy as np
import pytest
from gymnasium import spaces
from their_folders import write

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.datasets import layout as lay
from vispeg.datasets.episode import Recorder
from vispeg.datasets.read import Dataset
from vispeg.datasets.shards.plan import Plan
from vispeg.datasets.shards.rendering import render
from vispeg.learn.experience.shown import from_folder, successes
from vispeg.learn.layout import Layout
from vispeg.render.cameras.camera import Camera
from vispeg.render.image_kinds import STEP
from vispeg.task.peg.config import PegConfig
from vispeg.task.world_file import load_world

EYE = Camera("eye", 8, 8, 10.0, 10.0, 3.5, 3.5, pos=(0, 0, 0.5), quat=(0.0, 1.0, 0.0, 0.0))
PLAN = Plan("made", "0" * 64, frames=20, looks=1, cameras=("eye",), seed=3, shard_frames=20)
LAYOUT = lay.Layout(
    {
        "observation.policy": lay.numbers(("a", "b")),
        "label.environment_state": lay.numbers(("x", "y", "z")),
        "action": lay.numbers(("x", "y", "z")),
        "executed.action": lay.numbers(("x", "y", "z")),
        "next.reward": lay.number(),
        "observation.images.eye": lay.picture(EYE),
        "observation.depth.eye": lay.depth(EYE),
    },
    (EYE,),
    ("peg",),
    6.25,
    "Do it.",
    "nobody",
)
GREY = {"dtype": "image", "shape": [8, 8, 1], "names": ["height", "width", "channels"]}
BEFORE = replace(  # as datasets were laid out at first
    LAYOUT,
    features={k: f for k, f in LAYOUT.features.items() if not k.startswith(("label.", "observation.depth"))}
    | {
        "observation.environment_state": lay.numbers(("x", "y", "z")),
        "observation.images.eye_depth": GREY | {"info": {"is_depth_map": True, "depth_unit": "m"}},
    },
)
SEEN = Layout(2, {"depth_eye": (1, 8, 8), "rgb_eye": (3, 8, 8)}, 3)


BESIDE = spaces.Dict(
    {
        "policy": spaces.Box(-9, 9, (2,), np.float32),
        "privileged": spaces.Box(-9, 9, (3,), np.float32),
        "depth_eye": spaces.Box(0, 4, (1, 8, 8), np.float32),
        "rgb_eye": spaces.Box(0, 255, (3, 8, 8), np.uint8),
    }
)


def episodes(layout, failed=()):
    for number in range(4):
        recorder = Recorder(layout)
        for step in range(5):
            rng = stream(number, "frame", step)
            state = rng.standard_normal(2), rng.standard_normal(3)
            actions = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3), rng.uniform(-1, 1)
            colour = rng.integers(0, 256, (8, 8, 3), dtype=np.uint8)
            depth = rng.uniform(0.1, 1, (8, 8)).astype(np.float32)
            recorder.add(
                {
                    "observation.policy": state[0],
                    "label.environment_state": state[1],
                    "observation.environment_state": state[1],
                    "action": actions[0],
                    "executed.action": actions[1],
                    "next.reward": actions[2],
                    "observation.images.eye": colour,
                    "observation.depth.eye": depth,
                    "observation.images.eye_depth": depth,
                }
            )
        about = {"task": layout.task, "seed": number, "look": 0, "redraws": 0, "redraws_exhausted": False, "cut": False}
        ending = {"success": number not in failed, "category": "made", "world": {}, "cameras": []}
        yield recorder.finish(about | ending)


def made(out, failed=(), laid=LAYOUT, plan=PLAN):
    return render(plan, laid, lambda plan, layout, shard: episodes(layout, failed), out, workers=0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return made(tmp_path_factory.mktemp("data") / "demos")


@pytest.mark.parametrize(("beside", "feature"), [(None, "action"), (BESIDE, "executed.action")])
def test_every_frame_is_there_with_its_action(folder, beside, feature):
    ring, data = from_folder(folder, "rgbd", SEEN, 0, beside=beside), Dataset(folder)
    at, row = np.nonzero(ring.starts)
    batch = ring._batch(at, row)
    assert len(at) == len(data) == 20
    frames = [data[i] for i in range(20)]

    def column(name):
        return np.stack([frame[name] for frame in frames])

    assert np.allclose(batch.obs["policy"].numpy(), column("observation.policy"), atol=1e-6)
    assert np.allclose(batch.obs["privileged"].numpy(), column("label.environment_state"), atol=1e-6)
    assert np.allclose(batch.action.numpy(), column(feature), atol=1e-6)
    assert np.array_equal(np.moveaxis(batch.obs["rgb_eye"].numpy(), 1, -1), column("observation.images.eye"))
    depth = batch.obs["depth_eye"].numpy()[:, 0]
    assert np.abs(depth - column("observation.depth.eye")).max() <= 0.5 * STEP + 1e-6
    assert batch.done.numpy().tolist() == [0, 0, 0, 0, 1] * 4
    assert np.allclose(batch.reward.numpy(), column("next.reward") if beside else 0)
    on = batch.done.numpy()[:-1] == 0
    assert np.array_equal(batch.next_obs["policy"].numpy()[:-1][on], batch.obs["policy"].numpy()[1:][on])


def test_a_dataset_laid_out_as_before_shows_the_same(folder, tmp_path):
    now = from_folder(folder, "rgbd", SEEN, 0, beside=BESIDE)
    then = from_folder(made(tmp_path / "d", laid=BEFORE), "rgbd", SEEN, 0, beside=BESIDE)
    at, row = np.nonzero(now.starts)
    for key in BESIDE.spaces:
        assert np.array_equal(now._batch(at, row).obs[key].numpy(), then._batch(at, row).obs[key].numpy()), key


def test_batches_are_where_they_are_asked_for(folder):
    batch = from_folder(folder, "rgbd", SEEN, 0, "meta").sample(4)
    assert {part.device.type for part in (*batch.obs.values(), *batch.next_obs.values(), batch.action)} == {"meta"}


def test_a_dataset_of_another_observation_is_refused(folder):
    with pytest.raises(UserError, match="another observation"):
        from_folder(folder, "depth", Layout(2, {"depth_eye": (1, 9, 9)}, 3), 0)
    with pytest.raises(UserError, match="no such feature"):
        from_folder(folder, "depth", Layout(2, {"depth_other": (1, 8, 8)}, 3), 0)
    with pytest.raises(UserError, match="actions of another length"):
        from_folder(folder, "proprio", Layout(2, {}, 6), 0)
    with pytest.raises(UserError, match="does not hold what such a policy observes"):
        from_folder(folder, "state", Layout(2, {}, 3), 0)
    larger = spaces.Dict(BESIDE.spaces | {"privileged": spaces.Box(-9, 9, (4,), np.float32)})
    with pytest.raises(UserError, match="another observation"):
        from_folder(folder, "rgbd", SEEN, 0, beside=larger)


@pytest.mark.parametrize(
    ("world", "settings", "refused"),
    [
        ("effects: [{effect: brightness, where: all, params: {change: 0.2}}]", {}, None),  # it only looks otherwise
        ("task: {offset: 0.02}", {}, "offset: was recorded with other actions"),
        ("task: {turn: 0.02}", {}, None),  # nothing turns
        ("base: nominal", {"dof": ("x", "z", "y")}, "dof: was recorded with other actions"),
        ("base: nominal", {"policy_period": 0.08}, "policy_period: was recorded with other actions"),
        ("base: nominal", {"reward": "paper"}, "was recorded with other rewards"),
        ("base: nominal", {"reward_scale": 0.1}, "was recorded with other rewards"),
    ],
)
def test_a_folders_numbers_must_mean_what_the_learners_task_means(tmp_path, world, settings, refused):
    file = tmp_path / "mine.yaml"
    file.write_text(f"format: vispeg-world/1\n{world}\n")
    folder = made(tmp_path / "d", plan=replace(PLAN, world=str(file), world_hash=load_world(file).hash))
    shown = (folder, "rgbd", SEEN, 0, "cpu")
    if refused is None or refused.endswith("rewards"):  # imitation reads no rewards
        from_folder(*shown, config=PegConfig(**settings))
    if refused is None:
        from_folder(*shown, BESIDE, config=PegConfig(**settings))
    else:
        with pytest.raises(UserError, match=refused):
            from_folder(*shown, BESIDE, config=PegConfig(**settings))
    file.write_text("format: vispeg-world/1\ntask: {offset: 0.03}\n")  # of a world that has changed nothing is known
    from_folder(*shown, config=PegConfig())


def test_only_episodes_that_succeeded_are_shown(tmp_path):
    folder = made(tmp_path / "some", failed=(0, 2))
    ring, data = from_folder(folder, "rgbd", SEEN, 0), Dataset(folder)
    at, row = np.nonzero(ring.starts)
    kept = [*range(5, 10), *range(15, 20)]
    seen = ring._batch(at, row).obs["policy"].numpy()
    assert np.allclose(seen, np.stack([data[i]["observation.policy"] for i in kept]), atol=1e-6)
    with pytest.raises(UserError, match="no episode of the dataset succeeded"):
        from_folder(made(tmp_path / "none", failed=range(4)), "rgbd", SEEN, 0)


@pytest.mark.parametrize(("less", "wanted"), [((), [0, 2]), (("next.success",), [0, 1, 2])])
def test_another_writers_dataset_says_by_its_steps_who_succeeded_or_not_at_all(tmp_path, less, wanted):
    episodes = []
    for reached in ([0, 0, 1], [0, 0, 0], [0, 1, 1]):
        some = {"observation.state": np.zeros((3, 2)), "action": np.zeros((3, 3))}
        episodes.append({k: v for k, v in (some | {"next.success": np.array(reached, bool)}).items() if k not in less})
    write(tmp_path, episodes, {"observation.state": ["a", "b"], "action": ["x", "y", "z"]})
    assert successes(Dataset(tmp_path, theirs=True)) == wanted


@pytest.mark.parametrize("beside", [True, False])
@pytest.mark.parametrize("recorded", [True, False])
def test_an_episode_terminates_only_where_success_is_recorded(tmp_path, beside, recorded):
    """Else its value goes on from its last frame, which imitation has too."""
    episodes = []
    for number in range(2):
        policy = 10.0 * number + np.arange(3.0)[:, None] + np.zeros(2)
        some = {"observation.policy": policy, "observation.environment_state": np.zeros((3, 3))}
        some |= {"action": np.zeros((3, 3)), "next.reward": np.zeros(3)}
        episodes.append(some | ({"next.success": np.array([0, 0, 1], bool)} if recorded else {}))
    write(tmp_path, episodes, {"observation.policy": ["a", "b"], "action": ["x", "y", "z"]})
    space = spaces.Dict({key: BESIDE[key] for key in ("policy", "privileged")})
    ring = from_folder(tmp_path, "proprio", Layout(2, {}, 3), 0, beside=space if beside else None)
    at, row = np.nonzero(ring.starts)
    batch = ring._batch(at, row)
    whole = recorded or not beside
    assert batch.done.tolist() == ([0, 0, int(recorded)] * 2 if whole else [0, 0, 0, 0])
    assert batch.obs["policy"][:, 0].tolist() == ([0, 1, 2, 10, 11, 12] if whole else [0, 1, 10, 11])
    if not whole:
        assert batch.next_obs["policy"][:, 0].tolist() == [1, 2, 11, 12]
