"""The coarse policy acts far from the hole, the fine one from there on, told the hole where the coarse one saw it."""

import json
import shutil

import numpy as np
import pytest
import torch

from vispeg.core.errors import UserError
from vispeg.learn.coarse_to_fine import CoarseToFine, combine, open_policy
from vispeg.learn.layout import Layout
from vispeg.learn.modalities import modality
from vispeg.learn.networks.actor import Actor
from vispeg.learn.policy import NetPolicy, save
from vispeg.learn.shipped import policy_folder

STACK, FRAME, SCALE = 2, 15, 0.03


def net(name, images=None, vector=STACK * FRAME):
    torch.manual_seed(len(name))
    return NetPolicy(Actor(Layout(vector, images or {}, 3), modality(name), (16,)), name, {"world_hash": name})


class Seer(NetPolicy):
    """A coarse policy that sees the hole exactly where it is."""

    def __init__(self, hole):
        super().__init__(net("depth", {"depth_wrist": (1, 24, 24)}).actor, "depth")
        self.hole = np.asarray(hole)

    def act(self, obs):
        action = super().act(obs)
        self.estimate = SCALE * obs["policy"][:, :3] - [*self.hole, 0]
        return action


def seen(tips, n=None):
    """Observations of tips (n, 2) m relative to the nominal hole; the older frame of the stack is 5 mm behind."""
    rng = np.random.default_rng(0)
    vector = rng.standard_normal((len(tips), STACK, FRAME)).astype(np.float32)
    vector[:, 0, :2], vector[:, 1, :2] = np.array(tips) / SCALE, (np.array(tips) - 0.005) / SCALE
    image = rng.uniform(0.1, 0.3, (len(tips), 1, 24, 24)).astype(np.float32)
    return {"policy": vector.reshape(len(tips), -1), "depth_wrist": image}


def test_who_acts_and_what_the_fine_policy_is_told():
    hole = np.array([0.012, -0.02])
    both, fine = CoarseToFine(Seer(hole), net("state"), 0.006), net("state")
    tips = hole + [[0.0059, 0], [0.0061, 0], [0, 0.02]]
    obs = seen(tips)
    both.reset(3)
    actions = both.act(obs)
    assert both.fine_has.tolist() == [True, False, False]
    assert np.array_equal(actions[1:], both.coarse.act(obs)[1:])
    told = obs["policy"].reshape(3, STACK, FRAME).copy()
    told[..., :2] -= hole / SCALE  # tip relative to the hole itself, in every frame of the stack
    np.testing.assert_allclose(actions[0], fine.act({"policy": told.reshape(3, -1)})[0], atol=1e-6)


def test_the_fine_policy_keeps_its_episode_and_its_hole_until_the_next_one():
    both = CoarseToFine(Seer([0.0, 0.0]), net("state"), 0.006)
    both.reset(2)
    both.act(seen([[0.001, 0], [0.001, 0]]))
    both.coarse.hole = np.array([0.01, 0.01])  # what it sees later no longer counts
    both.act(seen([[0.03, 0.03], [0.03, 0.03]]))
    assert both.fine_has.all() and np.abs(both.goal).max() < 1e-9
    both.reset(2, np.array([True, False]))
    both.act(seen([[0.03, 0.03], [0.03, 0.03]]))
    assert both.fine_has.tolist() == [False, True]
    np.testing.assert_allclose(both.goal, [[0.01, 0.01], [0, 0]], atol=1e-9)


def test_a_blind_fine_policy_sees_what_the_task_gives():
    both = CoarseToFine(Seer([0.01, 0.0]), net("proprio"), 1.0)
    both.reset(2)
    obs = seen([[0.0, 0.0], [0.02, 0.0]])
    np.testing.assert_allclose(both.act(obs), net("proprio").act(obs), atol=1e-6)


def test_on_disk(tmp_path):
    """Both act as in memory, and the worlds that either was trained in are remembered."""
    coarse, fine = net("depth", {"depth_wrist": (1, 24, 24)}), net("state")
    for name, policy in (("a", coarse), ("b", fine)):
        save(tmp_path / name, policy.actor, policy.modality, policy.meta)
    combine(tmp_path / "a", tmp_path / "b", 0.02, tmp_path / "both")
    found, here = open_policy(tmp_path / "both"), CoarseToFine(coarse, fine, 0.02)
    assert set(found.meta["world_hashes"]) == {"depth", "state"} and open_policy(tmp_path / "a").modality == "depth"
    obs = seen([[0.0, 0.0], [0.05, 0.0]])
    for policy in (found, here):
        policy.reset(2)
    np.testing.assert_array_equal(found.act(obs), here.act(obs))
    with pytest.raises(UserError):
        combine(tmp_path / "a", tmp_path / "b", 0.02, tmp_path / "both")


@pytest.mark.parametrize(
    ("fine", "within"), [(net("state", vector=15), 0.006), (net("state"), 0.0), (net("state"), 1.5)]
)
def test_what_does_not_fit_is_refused(fine, within):
    with pytest.raises(UserError):
        CoarseToFine(net("depth", {"depth_wrist": (1, 24, 24)}), fine, within)


@pytest.mark.parametrize(("key", "value"), [("offset", 0.005), ("policy_period", 0.08), ("dof", ["x", "z", "y"])])
def test_a_fine_policy_whose_actions_mean_something_else_is_refused(tmp_path, key, value):
    fine = shutil.copytree(policy_folder("state-0.5mm"), tmp_path / "fine")
    combine("depth-S", fine, 0.006, tmp_path / "as-shipped")
    record = json.loads((fine / "policy.json").read_text())
    record["meta"]["task"][key] = value
    (fine / "policy.json").write_text(json.dumps(record))
    with pytest.raises(UserError, match=f"{key}: the fine policy was made for other actions"):
        combine("depth-S", fine, 0.006, tmp_path / "both")
