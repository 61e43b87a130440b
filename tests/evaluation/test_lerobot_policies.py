"""Policies that LeRobot saved, played in a process of their own row by row as alone; the task as LeRobot's environment.

LeRobot itself takes minutes to install; `scripts/try_lerobot.py`, a slow test, plays a real one. Here a package of its
name and with the three functions that are called stands in its place.
"""

import json
import os
import sys
import venv
from pathlib import Path

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import vispeg
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.evaluation.entrants import entrant
from vispeg.evaluation.lerobot import LeRobot
from vispeg.interface.lerobot import PYTHON
from vispeg.task.environments.lerobot_env import LeRobotEnv
from vispeg.task.environments.vector import TaskVec
from vispeg.trials.trial import folders, read_trial

FACTORY = """
from collections import deque
from pathlib import Path
import json
import torch

class Chunks(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.network = torch.nn.Linear(1, 1)
    @classmethod
    def from_pretrained(cls, folder, config):
        out = json.loads((Path(folder) / "config.json").read_text())["output_features"]["action"]
        return cls() if out["shape"] == [3] else Joints()
    def reset(self):
        self.queue = deque()
    def select_action(self, batch):
        if not self.queue:
            state, image = batch["observation.state"], batch["observation.images.wrist_wide"]
            assert image.shape == (1, 3, 16, 16) and 0 <= image.min() and image.max() <= 1 and batch["task"] == ""
            down = torch.stack([state[0, 7], image.mean(), torch.tensor(-0.5)])
            self.queue.extend([down[None], 2 * down[None]])
        return self.queue.popleft()

class Joints(Chunks):
    def reset(self):
        pass
    def select_action(self, batch):
        assert batch["observation.state"].shape == (1, 7)  # the joints alone
        step = torch.tensor([0.0, 0.01, 0.0, 0.0, 0.0, -0.01, 0.0])
        return 2 * (batch["observation.state"] + step).flip(1)

def get_policy_class(kind):
    assert kind == "act"
    print("what a library prints is no answer")
    return Chunks

def make_pre_post_processors(config, pretrained_path, preprocessor_overrides):
    before = lambda seen: {k: v if isinstance(v, str) else v[None] for k, v in seen.items()}
    return before, lambda action: 0.5 * action
"""
CONFIGS = """
class PreTrainedConfig:
    type = "act"
    @classmethod
    def from_pretrained(cls, folder):
        return cls()
"""


class Same:
    """What the policy above does, in this process and for one episode at a time."""

    obs_mode, measured = "rgb", True
    task = {"cameras": ("wrist_wide",), "image_size": 16}

    def reset(self, n):
        self.queue = []

    def act(self, obs):
        if not self.queue:
            mean = np.mean(obs["rgb_wrist_wide"][0] / np.float32(255))
            self.queue = [0.5 * k * np.array([[obs["measured"][0, 7], mean, -0.5]]) for k in (1, 2)]
        return self.queue.pop(0)


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """An interpreter that has a package called lerobot."""
    environment = tmp_path_factory.mktemp("environment")
    venv.create(environment, symlinks=True)
    (place,) = environment.glob("lib/python3*/site-packages")
    (place / "others.pth").write_text(str(Path(np.__file__).parents[1]))
    for name, text in (("policies/factory.py", FACTORY), ("configs/policies.py", CONFIGS)):
        file = place / "lerobot" / name
        file.parent.mkdir(parents=True)
        file.write_text(text)
    return environment / "bin" / "python"


class SameJoints:
    obs_mode, measured, action, task = *("rgb", True, "joint_goal"), Same.task

    def act(self, obs):
        return obs["measured"][:, :7] + np.float32([0.0, 0.01, 0.0, 0.0, 0.0, -0.01, 0.0])


def saved(place, state=19, shape=(3, 16, 16), action=3, names=None):
    """A folder as `lerobot-train` writes it, less its numbers."""
    folder = place / "act" / "checkpoints" / "last" / "pretrained_model"
    folder.mkdir(parents=True)
    seen = {"observation.state": {"type": "STATE", "shape": [state]}}
    seen["observation.images.wrist_wide"] = {"type": "VISUAL", "shape": list(shape)}
    config = {"input_features": seen, "output_features": {"action": {"type": "ACTION", "shape": [action]}}}
    (folder / "config.json").write_text(json.dumps(config))
    if names:
        info = {"features": {"action": {"dtype": "float32", "shape": [action], "names": names}}}
        (place / "data" / "meta").mkdir(parents=True)
        (place / "data" / "meta" / "info.json").write_text(json.dumps(info))
        (folder / "train_config.json").write_text(json.dumps({"dataset": {"root": str(place / "data")}}))
    return folder


def test_it_plays_as_the_same_policy_does_in_this_process(tmp_path, python, monkeypatch):
    """Side by side and one after the other: each row's queue of actions is its own."""
    monkeypatch.setenv(PYTHON, str(python))
    folder = saved(tmp_path)
    who = entrant(f"lerobot:{folder}")
    assert (who.name, who.modality, dict(who.task)) == ("act", "rgb", Same.task) and not who.alone
    theirs = vispeg.evaluate({"same": f"lerobot:{folder}"}, world="S", episodes=3, videos=0, task={"steps": 6})
    ours = vispeg.evaluate({"same": Same()}, world="S", episodes=3, videos=0, task={"steps": 6})
    for one, other in zip(theirs.episodes, ours.episodes, strict=True):
        assert (one.seed, one.category, one.time) == (other.seed, other.category, other.time)
        assert one.lateral_error == pytest.approx(other.lateral_error, rel=1e-6), "means of pixels round otherwise"


def test_the_names_of_its_dataset_say_that_it_acts_in_joints(tmp_path, python, monkeypatch, capsys):
    """In the order in which they stand there; where the dataset is not at hand, the kind has to be said."""
    monkeypatch.setenv(PYTHON, str(python))
    names = {"motors": [f"joint{i}.pos" for i in range(7, 0, -1)]}
    named = saved(tmp_path / "named", state=7, action=7, names=names)
    theirs = vispeg.evaluate({"same": f"lerobot:{named}"}, world="nominal", episodes=2, task={"steps": 4})
    ours = vispeg.evaluate({"same": SameJoints()}, world="nominal", episodes=2, task={"steps": 4})
    for one, other in zip(theirs.episodes, ours.episodes, strict=True):
        assert one.lateral_error == pytest.approx(other.lateral_error, abs=1e-6) and one.depth == pytest.approx(
            other.depth
        )
    (tmp_path / "named" / "data" / "meta" / "info.json").unlink()
    argv = ["evaluate", f"lerobot:{named}", "--world", "nominal", "--episodes", "1", "--out", str(tmp_path / "out")]
    assert main([*argv, "--quiet"]) == 2 and not (tmp_path / "out" / "evaluate.json").exists()
    err = capsys.readouterr().err.strip()
    assert "the meaning of its actions is not stated" in err and "joint_goal" in err and "\n" not in err
    assert entrant(f"lerobot:{named}?action=joint_goal").digest != entrant(f"lerobot:{named}").digest
    other = vispeg.evaluate(f"lerobot:{named}?action=joint_delta", world="nominal", episodes=1, task={"steps": 1})
    assert other.episodes[0].policy == "act"


def test_a_row_that_begins_forgets_and_the_others_go_on(tmp_path, python, monkeypatch):
    monkeypatch.setenv(PYTHON, str(python))
    policy = LeRobot(saved(tmp_path))
    env = TaskVec(2, "nominal", obs_mode="rgb", measured=True, seed=3, **Same.task)
    obs = env.reset()[0]
    policy.reset(2)
    first, second = policy.act(obs), policy.act(obs)
    np.testing.assert_allclose(second, 2 * first, rtol=1e-6)
    policy.act(obs)
    policy.reset(2, np.array([False, True]))
    np.testing.assert_allclose(policy.act(obs), [second[0], first[1]], rtol=1e-6)
    env.close()


def test_it_runs_on_a_robot(tmp_path, python, monkeypatch, capsys):
    """On a robot that is simulated in a process of its own it does what it does in an evaluation."""
    monkeypatch.setenv(PYTHON, str(python))
    text = f"lerobot:{saved(tmp_path)}"
    assert main(["run", text, "--robot", "sim:S", "--out", str(tmp_path / "trials")]) == 2
    assert "does not say which arm" in capsys.readouterr().err and not (tmp_path / "trials").exists()
    argv = [
        "run",
        text,
        "--robot",
        "sim:S",
        "--world",
        "S",
        "--seed",
        "3",
        "--quiet",
        "--out",
        str(tmp_path / "trials"),
    ]
    assert main(argv) == 0
    (folder,) = folders(tmp_path / "trials")
    trial = read_trial(folder)
    first, second = trial.steps.action[:2]
    np.testing.assert_allclose(second, 2 * first, rtol=1e-6)  # a chunk of two, from one observation
    env = TaskVec(1, "S", obs_mode="rgb", measured=True, **Same.task)
    obs, same = env.reset(seed=[3])[0], Same()
    same.reset(1)
    np.testing.assert_allclose(first, same.act(obs)[0], atol=0.02)  # a picture was taken at another moment
    env.close()


def test_what_cannot_be_played_is_one_line(tmp_path, python, monkeypatch, capsys):
    monkeypatch.setenv(PYTHON, str(python))
    other = saved(tmp_path / "other", state=6)
    plain = tmp_path / "another"
    plain.mkdir()
    (plain / "config.json").write_text("{}")
    cases = {
        f"lerobot:{tmp_path / 'none'}": "none/config.json: ",
        f"lerobot:{plain}": "another/config.json: not a policy that LeRobot saved",
        f"lerobot:{other}": "was trained with another state than this robot has",
        f"lerobot:{saved(tmp_path / 'size', shape=(3, 8, 8))}": "AssertionError",
        f"lerobot:{saved(tmp_path / 'wide', shape=(3, 16, 24))}": "not square; expected as high as wide",
        f"lerobot:{saved(tmp_path / 'flat', shape=(3,))}": "not square",
    }
    for policy, said in cases.items():
        argv = ["evaluate", policy, "--world", "nominal", "--episodes", "1", "--videos", "0"]
        assert main([*argv, "--out", str(tmp_path / "out"), "--quiet"]) == 2
        err = capsys.readouterr().err.strip()
        assert said in err and "\n" not in err and not (tmp_path / "out" / "evaluation.json").exists()


def test_without_lerobot_the_way_to_it_is_said(tmp_path, monkeypatch):
    folder = saved(tmp_path)
    monkeypatch.delenv(PYTHON, raising=False)
    with pytest.raises(UserError, match=f"needs lerobot; expected pip install lerobot, .* and {PYTHON} set to"):
        LeRobot(folder)
    monkeypatch.setenv(PYTHON, os.devnull)
    with pytest.raises(UserError, match=f"{PYTHON}: cannot be run"):
        LeRobot(folder).reset(1)
    monkeypatch.setenv(PYTHON, sys.executable)  # has none
    with pytest.raises(UserError, match="No module named 'lerobot'"):
        LeRobot(folder).reset(1)


def test_the_environment_of_lerobot_shows_what_the_task_shows(tmp_path):
    """Its episodes are those of the seed, its pictures and readings those of the task's own environment."""
    env = LeRobotEnv("S", ("external",), 24)
    check_env(env, skip_render_check=True)
    one, own = env, vispeg.make("S", "rgb", measured=True, cameras=("external",), image_size=24, steps=3)
    own_steps = own.vec.config.steps
    assert one._max_episode_steps == 50 and own_steps == 3 and one.task == one.task_description
    told, _ = one.reset(seed=7)
    obs, _ = own.reset(seed=7)
    for _ in range(3):
        assert np.array_equal(told["pixels"]["external"], np.moveaxis(obs["rgb_external"], 0, -1))
        assert np.array_equal(told["agent_pos"], obs["measured"])
        action = np.array([0.1, -0.2, -1.0], np.float32)
        told, reward, _, _, info = one.step(action)
        obs, other, *_ = own.step(action)
        assert reward == other and info == {"is_success": False}
    one.close()
    own.close()
