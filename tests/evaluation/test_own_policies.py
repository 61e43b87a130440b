"""Policies of a user's own: what acts is evaluated, as it acts by itself, and what does not is one line."""

import json
import shutil
import sys

import gymnasium as gym
import numpy as np
import pytest
import yaml

import vispeg
from vispeg.api.export.policy import export_policy
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.evaluation.entrants import entrant, entrants, refuse_trained_on
from vispeg.evaluation.jobs import seeds_of
from vispeg.evaluation.players import own_player
from vispeg.interface.exported import Exported
from vispeg.learn import onnx
from vispeg.learn.evaluation import run_episodes
from vispeg.learn.interface import interface_of_policy
from vispeg.learn.modalities import modality
from vispeg.learn.networks.actor import Actor
from vispeg.learn.policy import NetPolicy, load
from vispeg.learn.shipped import policy_folder
from vispeg.task.environments.vector import TaskVec
from vispeg.task.scripted import Scripted
from vispeg.task.world_file import load_world
from vispeg.trials.trial import FILE, NAME, PolicyPart, read_said
from vispeg.trials.trial import _example as example

CODE = """
import numpy as np

class Down:
    obs_mode = "proprio"
    def __init__(self):
        self.began = []
    def reset(self, n, rows=None):
        self.began.append(rows)
    def act(self, obs):
        assert set(obs) == {"policy"}
        return np.tile([0.0, 0.0, -0.5], (len(obs["policy"]), 1))

def down(obs):
    return np.tile([0.0, 0.0, -0.5], (len(obs["policy"]), 1))
"""


@pytest.fixture(scope="module")
def module(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    (folder / "own_policy_of_test.py").write_text(CODE)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        yield folder
    sys.modules.pop("own_policy_of_test", None)


def outcome(result):
    return [(e.policy, e.seed, e.category, e.time, e.peak_force) for e in result.episodes]


class Alone:
    """The scripted expert for one episode at a time, as a stack of a robot has it: it is told of no rows."""

    obs_mode = "state"

    def __init__(self):
        env = TaskVec(1, "nominal")
        self.expert, self.most = Scripted(env.config), 0

    def reset(self, n):
        self.expert.reset(n)

    def act(self, obs):
        self.most = max(self.most, len(obs["policy"]))
        return self.expert.act(obs)[0]


def test_an_object_a_function_and_a_module_play_what_the_policy_inside_plays(module):
    """The same episodes, however they are named; the expert wrapped is the expert."""
    import own_policy_of_test as own

    same = {"episodes": 3, "task": {"steps": 12}}
    by = [own.Down(), own.Down, own.down, "own_policy_of_test:Down", "own_policy_of_test:down", {"other": own.Down()}]
    told = [outcome(vispeg.evaluate(policy, "nominal", **same)) for policy in by]
    assert all([row[1:] for row in one] == [row[1:] for row in told[0]] for one in told)
    assert [one[0][0] for one in told] == ["Down", "Down", "down", "Down", "down", "other"]
    alone, expert = Alone(), vispeg.evaluate("expert", "nominal", episodes=3)
    wrapped = vispeg.evaluate({"expert": alone}, "nominal", episodes=3)
    assert outcome(wrapped) == outcome(expert) and alone.most == 1 and all(e.success for e in wrapped.episodes)


def test_one_that_plays_alone_is_shown_the_images_of_the_episode_before():
    class Looks:
        obs_mode, task = "depth", {"image_size": 8, "cameras": ("wrist_wide",)}

        def __init__(self):
            self.shown = []

        def reset(self, n):
            self.shown.append([])

        def act(self, obs):
            self.shown[-1].append(obs["depth_wrist_wide"][0])
            return np.zeros(3)

    looks, same = Looks(), {"episodes": 2, "task": {"steps": 3}}
    assert [e.seed for e in vispeg.evaluate(looks, "unknown_hole", controls="shuffled", **same).episodes][
        2:
    ] == seeds_of(2)
    plain, shuffled = looks.shown[:2], [some for some in looks.shown[2:] if some]
    assert len(shuffled) == 3, "one more than count, which comes first"
    np.testing.assert_array_equal(shuffled[2], plain[0])
    assert not np.array_equal(shuffled[1], plain[0]) and not np.array_equal(shuffled[1], plain[1])


def test_a_gap_and_a_command_take_them_too(module, tmp_path, capsys, monkeypatch):
    """And an evaluation of a module's policy goes on where it stopped."""
    import own_policy_of_test as own

    from vispeg.cli.main import main

    result = vispeg.gap([own.Down(), "expert"], ["nominal", "searching"], episodes=2, controls=())
    assert {p["name"] for p in result.record["policies"]} == {"Down", "expert"}
    out = tmp_path / "out"
    command = ["evaluate", "mine=own_policy_of_test:Down", "--episodes", "2", "--videos", "0", "--out", str(out)]
    assert main(command) == 0 and (out / "evaluate.html").is_file()
    assert main([*command, "--overwrite"]) == 0


def test_what_is_no_policy_is_said_in_one_line(module):
    """With what was expected; an error in the policy's own code with its place."""

    def broken(obs):
        return obs["absent"]

    class Thermal:
        obs_mode = "thermal"

        def act(self, obs):
            return obs

    for policy, said in (
        (3, "not a policy"),
        ("own_policy_of_test:absent", "no such policy"),
        ("no_such_module_here:Policy", "no such policy"),
        ("absent.zip", "no such policy"),
        (lambda obs: np.zeros(2), r"gives no actions; expected finite numbers of shape \(2, 3\)"),
        (lambda obs: np.full((len(obs["policy"]), 3), np.nan), "not finite"),
        (broken, r"broken failed: KeyError: 'absent' at test_own_policies.py:\d+"),
        (Thermal(), "obs_mode"),
        ([], "no policy given"),
    ):
        with pytest.raises(UserError, match=said) as refused:
            vispeg.evaluate(policy, "nominal", episodes=2, task={"steps": 3})
        assert "\n" not in str(refused.value)


def test_what_cannot_be_sent_to_a_worker_is_said_before_it_is_tried():
    with pytest.raises(UserError, match="another process.*MODULE:CLASS"):
        vispeg.evaluate(lambda obs: np.zeros((len(obs["policy"]), 3)), "nominal", episodes=60, workers=2)


@pytest.mark.parametrize("algorithm", ["SAC", "PPO", "TD3"])
def test_a_file_by_stable_baselines3_acts_as_that_library_loads_it(algorithm, tmp_path):
    """Without its pickles: depth as an image, the same actions, no ground truth; also the model in memory."""
    sb3 = pytest.importorskip("stable_baselines3")

    seen = {"cameras": ("wrist_wide",), "image_size": 36, "backend": "raycast"}
    env = vispeg.make("nominal", "depth", depth_image=True, **seen)
    more = {} if algorithm == "PPO" else {"buffer_size": 10}
    model = getattr(sb3, algorithm)("MultiInputPolicy", env, seed=3, policy_kwargs={"net_arch": [32, 16]}, **more)
    networks = model.policy if algorithm == "PPO" else model.actor
    extractors = networks.features_extractor.extractors
    assert set(extractors) == {"policy", "depth_wrist_wide"} and hasattr(extractors["depth_wrist_wide"], "cnn")
    model.save(tmp_path / "mine.zip")
    played = TaskVec(2, "nominal", "depth", privileged=True, autoreset_mode="Disabled", **seen)
    image, _ = TaskVec(2, "nominal", "depth", depth_image=True, **seen).reset(seed=1)
    metres, _ = played.reset(seed=1)
    expected = model.predict(image, deterministic=True)[0]
    for policy in (str(tmp_path / "mine.zip"), model):
        np.testing.assert_array_equal(own_player(entrants({"mine": policy})[0], played.config).act(metres), expected)
    result = vispeg.evaluate(str(tmp_path / "mine.zip"), "nominal", episodes=2, task={"steps": 2})
    assert [e.modality for e in result.episodes] == ["depth"] * 2 and result.episodes[0].policy == "mine"


class Pressing(gym.Env):
    """One of four buttons a step."""

    observation_space = gym.spaces.Dict({"policy": gym.spaces.Box(-20, 20, (30,), np.float32)})
    action_space = gym.spaces.Discrete(4)


def test_a_file_by_stable_baselines3_that_cannot_be_judged_is_refused(tmp_path):
    """One that reads the ground truth, one with classes of the user's own, no such file, one that presses buttons."""
    sb3 = pytest.importorskip("stable_baselines3")
    from torch import nn

    told = sb3.SAC("MultiInputPolicy", vispeg.make("nominal", privileged=True), buffer_size=10)
    told.save(tmp_path / "told.zip")
    own = {"buffer_size": 10, "policy_kwargs": {"activation_fn": nn.Tanh}}
    sb3.SAC("MultiInputPolicy", vispeg.make("nominal"), **own).save(tmp_path / "c.zip")
    (tmp_path / "text.zip").write_text("nothing")
    sb3.PPO("MultiInputPolicy", Pressing()).save(tmp_path / "pressing.zip")
    discrete = ("pressing", "action_space: acts otherwise.*got .*Discrete")
    for name, said in (("told", "ground truth"), ("c", "MODULE:FUNCTION"), ("text", "not such a file"), discrete):
        with pytest.raises(UserError, match=said):
            vispeg.evaluate(str(tmp_path / f"{name}.zip"), "nominal", episodes=2)


def test_rows_that_begin_are_told(module):
    """A policy with a memory learns which of its rows begin anew."""
    import own_policy_of_test as own

    policy, env = own.Down(), TaskVec(2, "nominal", "proprio", autoreset_mode="Disabled", steps=3)
    run_episodes(own_player(entrants({"down": policy})[0], env.config), env, seeds_of(3))
    assert policy.began[0] is None and [rows.tolist() for rows in policy.began[1:]] == [[True, True]]


def test_an_onnx_file_plays_what_the_network_in_it_plays(tmp_path, capsys, monkeypatch):
    """One or two side by side, in one process or two; what it says of itself counts as a folder's record does."""
    monkeypatch.chdir(tmp_path)
    export_policy("state-3mm", "other.onnx")
    folder = vispeg.evaluate("state-3mm", "nominal", episodes=4)
    for workers in (1, 2):
        again = vispeg.evaluate({"state-3mm": "other.onnx"}, "nominal", episodes=4, workers=workers)
        pairs = list(zip(again.episodes, folder.episodes, strict=True))
        assert len(pairs) == 4 and all((a.seed, a.category) == (b.seed, b.category) for a, b in pairs)
        for a, b in pairs:  # two libraries round otherwise, by 1e-5 of an action
            assert a.time == pytest.approx(b.time, abs=0.17) and a.peak_force == pytest.approx(b.peak_force, rel=0.05)
    one, other = entrant("state-3mm"), entrant("other.onnx")
    assert (other.name, other.modality, other.trained_on) == ("other", one.modality, one.trained_on)
    assert {k: other.task[k] for k in one.task} == dict(one.task)
    assert dict(other.parts) == dict(one.parts)
    said = read_said(example(tmp_path))  # a robot's trial states the policy that was exported
    tried = said.model_copy(update={"policy": PolicyPart(name="other", digest=one.digest)})
    (tmp_path / "trial-0001" / FILE).write_text(yaml.safe_dump({"format": NAME, **tried.model_dump(exclude_none=True)}))
    lost = vispeg.gap({"mine": "other.onnx"}, "nominal", episodes=1, controls="none", measured=tmp_path / "trial-0001")
    assert {(row["policy"], row["world"]) for row in lost.record["success"]} == {("mine", "nominal"), ("mine", "robot")}
    assert "trial-0001 holds trials of the task mine, not of peg" in lost.record["notes"]
    (tmp_path / "broken.onnx").write_bytes(b"no model")
    assert main(["evaluate", "broken.onnx", "--world", "nominal", "--out", "o"]) == 2
    assert "broken.onnx: is not an ONNX model" in capsys.readouterr().err and not (tmp_path / "o").exists()


def test_an_onnx_file_of_a_fine_tuned_policy_is_refused_where_its_folder_is(tmp_path):
    shutil.copytree(policy_folder("state-3mm"), tmp_path / "tuned")
    record = json.loads((tmp_path / "tuned" / "policy.json").read_text())
    target = load_world("randomized")
    record["meta"]["finetuned"] = {"world": "randomized", "world_hash": target.hash, "world_parts": {"1": "mine"}}
    (tmp_path / "tuned" / "policy.json").write_text(json.dumps(record))
    export_policy(tmp_path / "tuned", tmp_path / "tuned.onnx")
    one, other = entrant(str(tmp_path / "tuned")), entrant(str(tmp_path / "tuned.onnx"))
    assert target.hash in other.trained_on and set(other.trained_on) == set(one.trained_on)
    assert dict(other.parts) == dict(one.parts) and other.parts["1"] == "mine"
    for who in (one, other):
        with pytest.raises(UserError, match="tuned was trained in randomized"):
            refuse_trained_on([who], "randomized", target.hash)


def test_an_onnx_file_with_a_memory_forgets_only_the_episodes_that_begin(tmp_path):
    network, file = load("state-3mm"), tmp_path / "memory.onnx"
    actor = Actor(network.actor.layout, modality("state"), (32,), recurrent=8)
    meaning = interface_of_policy(network).model_copy(update={"recurrent": 8})
    onnx.export(NetPolicy(actor, "state", network.meta), file, meaning=meaning)
    kept, fresh, rng = Exported(file), Exported(file), np.random.default_rng(0)
    obs = [{"policy": rng.normal(size=(4, network.actor.layout.vector)).astype(np.float32)} for _ in range(3)]
    kept.reset(4)
    kept.act(obs[0])
    kept.reset(4, np.array([True, False, False, True]))
    fresh.reset(4)
    assert (kept.act(obs[1]) == fresh.act(obs[1])).all(axis=1).tolist() == [True, False, False, True]
