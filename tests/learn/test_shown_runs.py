"""A run learns from a folder of demonstrations as from a teacher, by imitation or with half of each batch from it."""

import csv
from dataclasses import replace

import numpy as np
import pytest
import torch
from toy import SIZE, Pointing, Reach

from vispeg.core.errors import UserError
from vispeg.datasets import layout as lay
from vispeg.datasets.episode import Recorder
from vispeg.datasets.shards.plan import Plan
from vispeg.datasets.shards.rendering import render
from vispeg.learn.config import TrainConfig, read_config
from vispeg.learn.evaluation import run_episodes, success_rate
from vispeg.learn.methods.rounds import Rounds
from vispeg.learn.methods.sac_run import SacRun
from vispeg.learn.policy import load
from vispeg.learn.settings import SacSettings
from vispeg.learn.train import resume, train
from vispeg.render.cameras.camera import Camera

EYE = Camera("wrist", SIZE, SIZE, 10.0, 10.0, 7.5, 7.5, pos=(0, 0, 0.5), quat=(0.0, 1.0, 0.0, 0.0))
FEATURES = {
    "observation.policy": lay.number(),
    "label.environment_state": lay.numbers(("x", "y", "age")),
    "action": lay.numbers(("x", "y", "z")),
    "next.reward": lay.number(),
    "observation.depth.wrist": lay.depth(EYE),
}
LAYOUT = lay.Layout(FEATURES, (EYE,), ("peg",), 6.25, "Reach.", "nobody")
WRONG = 5  # every fifth episode goes away from the target and fails
SAC = SacSettings(batch=32, hidden=(32, 32), warmup=80, replay=600, utd=0.25)


def shown(number):
    """An episode of the toy as a dataset holds it."""
    env, recorder, done = Reach(1, "depth"), Recorder(LAYOUT), False
    obs, _ = env.reset(seed=number)
    success = False
    while not done:
        action = Pointing().act(obs) * (-1 if number % WRONG == 0 else 1)
        before = obs
        obs, reward, success, late, _ = env.step(action)
        done = bool(success[0] or late[0])
        recorder.add(
            {
                "observation.policy": before["policy"][0],
                "label.environment_state": before["privileged"][0],
                "action": action[0],
                "next.reward": reward[0],
                "observation.depth.wrist": before["depth_wrist"][0, 0],
            }
        )
    about = {"task": "Reach.", "seed": number, "look": 0, "redraws": 0, "redraws_exhausted": False, "cut": False}
    ending = {"success": bool(success[0]), "category": "made", "world": {}, "cameras": []}
    return recorder.finish(about | ending)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    episodes = [shown(number) for number in range(80)]
    frames = sum(map(len, episodes))
    plan = Plan("made", "0" * 64, frames=frames, cameras=("wrist",), shard_frames=frames)
    return render(plan, LAYOUT, lambda *_: iter(episodes), tmp_path_factory.mktemp("data") / "demos", workers=0)


def config(folder, recipe, **changes):
    base = {"steps": 320, "every": 160, "episodes": 8, "envs": 8, "sac": SAC, "distill": {"updates": 60}}
    return TrainConfig("peg-depth", recipe, dataset=str(folder), **(base | changes))


def make(rows, settings):
    return Reach(rows, "depth")


def curve(run):
    with (run / "progress.csv").open() as stream:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(stream)]


@pytest.mark.slow
def test_a_student_comes_near_what_a_folder_shows(folder, tmp_path):
    best = train(config(folder, "distill"), tmp_path / "run", make, False)
    assert success_rate(run_episodes(load(best), Reach(16, "depth"), range(900, 932))) > 0.9
    rows = curve(tmp_path / "run")
    assert [row["stage"] for row in rows] == [f"distill {k}" for k in range(5)]
    assert [row["updates"] for row in rows] == ["60", "120", "180", "240", "300"]
    assert all(row["steps"] == "0" for row in rows)
    assert load(best).meta["world_hashes"] == ["0" * 64]


def test_a_killed_cloning_goes_on_with_the_same_curve_and_then_reinforces_beside_the_folder(
    folder, tmp_path, monkeypatch
):
    c = config(folder, "distill+sac", distill={"updates": 5})
    train(c, tmp_path / "whole", make, False)
    keep = Rounds.keep

    def kill(self, *given):
        keep(self, *given)
        if self.done == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(Rounds, "keep", kill)
    with pytest.raises(KeyboardInterrupt):
        train(c, tmp_path / "part", make, False)
    monkeypatch.undo()
    torch.manual_seed(99)  # whatever happened in between
    resume(tmp_path / "part", make=make, show=False)
    assert curve(tmp_path / "part") == curve(tmp_path / "whole") and len(curve(tmp_path / "part")) == 7
    assert not (tmp_path / "part/demos").exists(), "the folder has them"


def test_reinforcement_from_scratch_takes_half_of_each_batch_from_the_folder(folder, tmp_path):
    c = config(folder, "sac")
    run = SacRun(c, tmp_path / "run", make, False)
    demos = run.model.demos
    assert demos is not None and int(demos.done.sum()) == 64  # the failures are left out
    at, row = np.nonzero(demos.starts & (demos.done > 0))
    assert (demos.reward[at, row] > 0.5).all()
    run.model.learn(160, log_interval=None)
    batch, taken = run.model._sample("both")
    assert taken == 16 and batch.reward.shape == (32,)
    run.close()


def test_a_killed_reinforcement_beside_a_folder_goes_on_with_the_same_curve(folder, tmp_path):
    c = config(folder, "sac")
    train(c, tmp_path / "whole", make, False)
    train(replace(c, steps=160), tmp_path / "part", make, False)
    resume(tmp_path / "part", 320, make, False)
    assert curve(tmp_path / "part") == curve(tmp_path / "whole")
    assert read_config(tmp_path / "part/config.yaml") == c


def test_a_folder_that_is_none_leaves_no_run_and_a_teacher_beside_it_is_refused(tmp_path):
    for recipe in ("sac", "distill"):
        with pytest.raises(UserError, match="is not a dataset"):
            train(config(tmp_path / "nowhere", recipe), tmp_path / "run", make, False)
        assert not (tmp_path / "run").exists()
    with pytest.raises(UserError, match="looks of a dataset are fixed"):
        train(config(tmp_path, "distill", distill={"looks": 2}), tmp_path / "run", make, False)
    with pytest.raises(UserError, match="takes the place of a teacher"):
        config(tmp_path, "distill", teacher="expert")
