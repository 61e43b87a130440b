"""The policies that come with the package: they load, say where they come from, and do what is said of them."""

import json

import numpy as np
import pytest

from vispeg.core.assets import assets
from vispeg.learn.policy import load
from vispeg.task.peg.config import PegConfig
from vispeg.task.vector import PegInHoleVec

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
