"""Policies of a user's own modality, cameras and image size play, are controlled and filmed as the built-in ones."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

import torch

from vispeg.evaluation import arena
from vispeg.evaluation.entrants import entrants
from vispeg.evaluation.films.media import film
from vispeg.evaluation.jobs import IMAGE_ROWS, Setting, make_jobs
from vispeg.learn import modalities, play
from vispeg.learn.layout import OFFSET_M, Layout
from vispeg.learn.modalities import Modality, enrol, modality
from vispeg.learn.networks.actor import Actor
from vispeg.learn.policy import load, save
from vispeg.task.peg.task import PegInHoleVec

TASK = {"stack": 3, "cameras": ["wrist_crop"], "image_size": 16}


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A policy of a modality called `mine`, which is depth, made for a stack and an image of its own."""
    modality("depth")  # so that the built-in ones are there before another is put among them
    monkeypatch.setattr(modalities, "_REGISTRY", dict(modalities._REGISTRY))
    own = enrol(Modality("mine", "depth", ("depth",), modality("depth").encoder, "as depth"))
    env = PegInHoleVec(1, "nominal", "depth", **{**TASK, "cameras": ("wrist_crop",)})
    torch.manual_seed(0)
    layout = Layout.of(env.single_observation_space, env.single_action_space, own.kinds)
    env.close()
    save(tmp_path / "mine", Actor(layout, own, (16,)), "mine", {"seed": 0, "world": "nominal", "task": TASK})
    settings = [Setting("nominal", "T", task={"steps": 2, "image_size": 24}, control=c) for c in ("", "shuffled")]
    yield make_jobs(entrants([str(tmp_path / "mine")]), settings, [1, 2, 3], tmp_path)
    for kept in arena._kept.values():
        kept.close()
    arena._kept.clear()


def test_a_modality_and_an_image_of_ones_own_are_evaluated(mine):
    assert [(j.control, j.rows) for j in mine] == [("", IMAGE_ROWS), ("shuffled", IMAGE_ROWS)], "it is known to see"
    plain, shuffled = (arena.play(job.split(2)[0]) for job in mine)
    assert [(e.modality, e.seed) for e in plain] == [("mine", 1), ("mine", 2)]
    assert {e.control for e in shuffled} == {"shuffled"}
    env = arena.environment(mine[0].split(2)[0])
    assert min(env.single_observation_space["depth_wrist_crop"].shape[1:]) == 16, "and not the world's 24"
    assert set(env.single_observation_space.spaces) == {"policy", "privileged", "depth_wrist_crop"}
    assert env.config.stack == 3 and env.config.steps == 2


def test_the_film_shows_where_the_policy_thinks_the_peg_and_where_it_is(mine):
    job = replace(mine[0], rows=1)
    env, policy = arena.environment(job), load(job.entrant.path)
    obs, _ = env.reset(seed=[1])
    policy.reset(1)
    policy.act(obs)
    thinks, is_ = (line.split() for line in play.positions(obs, policy))
    assert (thinks[0], is_[0]) == ("thinks", "is") and thinks[-1] == is_[-1] == "mm"
    np.testing.assert_allclose(np.array(is_[1:4], float), 1e3 * OFFSET_M * obs["privileged"][0, :3], atol=0.051)
    np.testing.assert_allclose(np.array(thinks[1:4], float), 1e3 * policy.estimate[0], atol=0.051)
    for frame in film(replace(job, rows=2), 1).frames:
        foot = frame[::-1, :200].astype(int)  # rows from the foot, where the cell is light
        drawn = (foot.max(axis=2) < 30).any(axis=1)  # the rim of a letter
        assert drawn[8:17].all() and drawn[22:31].all() and not drawn[:4].any() and not drawn[36:40].any(), "two lines"
