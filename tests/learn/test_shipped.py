"""The policies that come with the package: they load, say where they come from, and do what is said of them."""

import json

import numpy as np
import pytest
import torch

from vispeg.core.assets import assets
from vispeg.learn.networks.nets import LEAST, Scale
from vispeg.learn.policy import load
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.task import PegInHoleVec

FOLDERS = sorted(p.parent for p in (assets() / "policies").glob("*/policy.json"))


def episodes(folder, world, n, **task):
    """(success, category) of n episodes on seeds that training never drew."""
    policy = load(folder)
    env = PegInHoleVec(n, world, policy.modality, autoreset_mode="SameStep", backend="raycast", **task)
    obs, _ = env.reset(seed=2**31 + 1000)
    policy.reset(n)
    found = [None] * n
    while any(f is None for f in found):
        obs, _, _, _, info = env.step(policy.act(obs))
        for i in np.flatnonzero(info.get("_success", np.zeros(n, bool))):
            found[i] = found[i] or info["category"][i]
    env.close()
    return found


def test_every_modality_is_there():
    assert {load(f).modality for f in FOLDERS} >= {"state", "proprio", "depth", "rgb", "rgbd"}


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: f.name)
def test_a_policy_says_where_it_comes_from(folder):
    meta = json.loads((folder / "policy.json").read_text())["meta"]
    assert meta["command"].startswith("vispeg train ") and "/tmp" not in meta["command"]
    assert meta["world_hash"] and isinstance(meta["seed"], int)
    PegConfig.of(meta["task"])


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: f.name)
def test_a_policy_acts_without_the_ground_truth(folder):
    """Whatever `privileged` reads, or no such part: the same actions, bit for bit. Its critics are not shipped."""
    policy, rng = load(folder), np.random.default_rng(0)
    obs = {key: rng.uniform(0, 1, (3, *shape)).astype(np.float32) for key, shape in policy.layout.shapes.items()}
    obs |= {key: (255 * image).astype(np.uint8) for key, image in obs.items() if key.startswith("rgb_")}
    acts = []
    for more in ({}, {"privileged": rng.normal(size=(3, 22)).astype(np.float32)}):
        policy.reset(3)
        acts.append(policy.act({**obs, **more}))
    assert acts[0].tobytes() == acts[1].tobytes()
    assert not any("critic" in key for key in policy.actor.state_dict())


def test_an_episode_is_the_same_with_the_ground_truth_and_without():
    policy, played = load("state-3mm-randomized"), []
    for privileged in (False, True):
        env = PegInHoleVec(2, "randomized", "state", autoreset_mode="Disabled", privileged=privileged)
        obs, _ = env.reset(seed=[7, 8])
        policy.reset(2)
        assert ("privileged" in obs) == privileged
        for _ in range(12):
            obs, reward, *_ = env.step(policy.act(obs))
            played.append((obs["policy"].tobytes(), reward.tobytes()))
        env.close()
    assert played[:12] == played[12:]


def test_critics_are_fed_the_same_by_a_scale_and_by_its_mean_over_four_surfaces():
    """Friction was read as (scale + 3) / 4: standardized, as critics see it, that is the scale drawn.

    So a training is fed what it was fed before, to rounding, in the worlds that draw it at the peg alone, as all do.
    """
    env = PegInHoleVec(64, "randomized", "state", autoreset_mode="Disabled", privileged=True)
    truth = np.concatenate([env.reset(seed=[64 * i + j for j in range(64)])[0]["privileged"] for i in range(4)])
    at = env.observed["friction"]
    env.close()
    before = truth.copy()
    before[:, at] = (truth[:, at] + 3) / 4
    fed = []
    for read in (truth, before):
        scale = Scale(read.shape[1])
        scale.measure(torch.from_numpy(read))
        assert scale.spread[at].item() > LEAST
        fed.append(scale(torch.from_numpy(read)))
    assert torch.allclose(*fed, atol=1e-4) and fed[0][:, at].std().item() == pytest.approx(1, abs=1e-3)


def test_the_state_policy_inserts():
    """Nine of ten at least, where it was said to manage all."""
    found = episodes(assets() / "policies" / "state-3mm", "searching", 16)
    assert found.count("success") >= 14, found


def test_a_policy_sees_does_and_is_paid_in_an_episode_what_it_was_before_tasks_had_terms():
    """The figures are of the code that put an observation together by hand; another processor rounds."""
    policy = load("state-3mm")
    env = PegInHoleVec(2, "randomized", "state", autoreset_mode="Disabled", stack=2, privileged=True)
    obs, _ = env.reset(seed=[7, 8])
    policy.reset(2)
    np.testing.assert_allclose(obs["policy"][0, :3], [0.15921, 0.12660, 0.71853], atol=2e-4)
    truth = [0.16382, 0.11590, 0.69883, -0.55728, -0.22494, 0, 0.04615, -0.10697, -0.19702]
    truth += [0] * 9 + [0.51373, 1.06840, 0.78994, 1]
    np.testing.assert_allclose(obs["privileged"][0], truth, atol=2e-4)
    first = policy.act(obs)
    np.testing.assert_allclose(first, [[-0.82372, -0.08027, -0.98395], [0.98581, 0.97797, -0.82086]], atol=2e-3)
    obs, reward, *_ = env.step(first)
    np.testing.assert_allclose(reward, [-0.587891, -0.685550], atol=1e-3)
    second = [[0.01424, -0.46888, -0.86673], [0.93570, 0.95825, -0.82668]]
    np.testing.assert_allclose(policy.act(obs), second, atol=2e-2)
