"""Demonstrations read from a dataset are the dataset's own frames, in its order."""

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.datasets import layout as lay
from vispeg.datasets.episode import Recorder
from vispeg.datasets.plan import Plan
from vispeg.datasets.read import Dataset
from vispeg.datasets.rendering import render
from vispeg.learn.layout import Layout
from vispeg.learn.replay import DEPTH_STEP_M
from vispeg.learn.shown import from_folder
from vispeg.render.camera import Camera

EYE = Camera("eye", 8, 8, 10.0, 10.0, 3.5, 3.5, pos=(0, 0, 0.5), quat=(0.0, 1.0, 0.0, 0.0))
PLAN = Plan("made", "0" * 64, frames=20, looks=1, cameras=("eye",), seed=3, shard_frames=20)
LAYOUT = lay.Layout(
    {
        "observation.policy": lay.numbers(("a", "b")),
        "observation.environment_state": lay.numbers(("x", "y", "z")),
        "action": lay.numbers(("x", "y", "z")),
        "executed.action": lay.numbers(("x", "y", "z")),
        "observation.images.eye": lay.picture(EYE, 3),
        "observation.images.eye_depth": lay.picture(EYE, 1, depth=True),
    },
    (EYE,),
    ("peg",),
    6.25,
    "Do it.",
    "nobody",
)
SEEN = Layout(2, {"depth_eye": (1, 8, 8), "rgb_eye": (3, 8, 8)}, 3)


def source(plan, layout, shard):
    for number in range(4):
        recorder = Recorder(layout)
        for step in range(5):
            rng = stream(number, "frame", step)
            recorder.add(
                {
                    "observation.policy": rng.standard_normal(2),
                    "observation.environment_state": rng.standard_normal(3),
                    "action": rng.uniform(-1, 1, 3),
                    "executed.action": rng.uniform(-1, 1, 3),
                    "observation.images.eye": rng.integers(0, 256, (8, 8, 3), dtype=np.uint8),
                    "observation.images.eye_depth": rng.uniform(0.1, 1, (8, 8)).astype(np.float32),
                }
            )
        about = {"task": layout.task, "seed": number, "look": 0, "redraws": 0, "redraws_exhausted": False, "cut": False}
        yield recorder.finish(about | {"success": True, "category": "success", "world": {}, "cameras": []})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("data") / "demos"
    render(PLAN, LAYOUT, source, out, workers=0)
    return out


@pytest.mark.parametrize(("executed", "feature"), [(False, "action"), (True, "executed.action")])
def test_every_frame_is_there_with_its_action(folder, executed, feature):
    ring, data = from_folder(folder, SEEN, 0, executed), Dataset(folder)
    at, row = np.nonzero(ring.starts)
    batch = ring._batch(at, row)
    assert len(at) == len(data) == 20
    frames = [data[i] for i in range(20)]

    def column(name):
        return np.stack([frame[name] for frame in frames])

    assert np.allclose(batch.obs["policy"].numpy(), column("observation.policy"), atol=1e-6)
    assert np.allclose(batch.obs["privileged"].numpy(), column("observation.environment_state"), atol=1e-6)
    assert np.allclose(batch.action.numpy(), column(feature), atol=1e-6)
    assert np.array_equal(np.moveaxis(batch.obs["rgb_eye"].numpy(), 1, -1), column("observation.images.eye"))
    depth = batch.obs["depth_eye"].numpy()[:, 0]
    assert np.abs(depth - column("observation.images.eye_depth")).max() <= 0.5 * DEPTH_STEP_M + 1e-6
    assert batch.done.numpy().tolist() == [0, 0, 0, 0, 1] * 4
    on = batch.done.numpy()[:-1] == 0
    assert np.array_equal(batch.next_obs["policy"].numpy()[:-1][on], batch.obs["policy"].numpy()[1:][on])


def test_batches_are_where_they_are_asked_for(folder):
    batch = from_folder(folder, SEEN, 0, device="meta").sample(4)
    assert {part.device.type for part in (*batch.obs.values(), *batch.next_obs.values(), batch.action)} == {"meta"}


def test_a_dataset_of_another_observation_is_refused(folder):
    with pytest.raises(UserError, match="another observation"):
        from_folder(folder, Layout(2, {"depth_eye": (1, 9, 9)}, 3), 0)
    with pytest.raises(UserError, match="no such feature"):
        from_folder(folder, Layout(2, {"depth_other": (1, 8, 8)}, 3), 0)
    with pytest.raises(UserError, match="another action"):
        from_folder(folder, Layout(2, {}, 6), 0)
