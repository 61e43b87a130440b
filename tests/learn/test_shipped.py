"""The policies that come with the package: they load, say where they come from, and do what is said of them."""

import json

import numpy as np
import pytest

from vispeg.core.assets import assets
from vispeg.learn.policy import load
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.env import PegInHoleVec

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
