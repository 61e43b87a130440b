"""Batches are where the network is that learns from them. `meta` stands for a device wherever there is none."""

import pytest
import torch
from toy import Pointing, Reach

from vispeg.core.errors import UserError
from vispeg.learn.config import TrainConfig
from vispeg.learn.device import device_of
from vispeg.learn.experience.replay import mixed
from vispeg.learn.layout import Layout
from vispeg.learn.methods import distill as distilling
from vispeg.learn.methods import finetune as tuning
from vispeg.learn.methods.distill import DistillSettings, demonstrations, distill
from vispeg.learn.methods.finetune import FinetuneSettings, finetune
from vispeg.learn.methods.recipes import distilled
from vispeg.learn.methods.rounds import keep_ring, kept_ring
from vispeg.learn.modalities import modality
from vispeg.learn.networks.actor import Actor
from vispeg.learn.policy import load, save
from vispeg.learn.sb3_env import Sb3Env
from vispeg.learn.settings import SacSettings

cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
META = torch.device("meta")


def world(rows, settings):
    return Reach(rows, "depth")


def student():
    env, seen = Sb3Env(Reach(4, "depth")), modality("depth")
    return env, Actor(Layout.of(env.observation_space, env.action_space, seen.kinds), seen, (8,))


def devices(batch):
    parts = (*batch.obs.values(), *batch.next_obs.values(), batch.action, batch.reward, batch.done, batch.weight)
    return {part.device for part in parts}


def watched(monkeypatch, module):
    """Nothing is cloned in a module; the rings to clone from are kept in the list returned."""
    found = []
    monkeypatch.setattr(module, "clone", lambda actor, rings, *_, **__: found.extend(r for r, _ in rings) or 0.0)
    return found


def test_a_distillations_rings_are_where_its_student_is(monkeypatch):
    rings = watched(monkeypatch, distilling)
    env, actor = student()
    distill(actor.to(META), "depth", env, Pointing(), DistillSettings(betas=(1.0, 1.0), steps=40), 0)
    assert len(rings) == 3
    for ring in rings:
        assert devices(ring.sample(8)) == devices(ring.sequences(2, 5)) == {META}


def test_demonstrations_are_where_they_are_asked_for_also_after_they_were_stored(tmp_path):
    env, _ = student()
    ring, _ = demonstrations(env, Pointing(), 4, 0, META)
    keep_ring(ring, tmp_path / "demos")
    kept = kept_ring(tmp_path / "demos", ring)
    assert devices(mixed(ring.sample(4), kept.sample(4))) == {META}


def test_fine_tuning_draws_from_both_worlds_where_the_policy_is(tmp_path, monkeypatch):
    rings = watched(monkeypatch, tuning)
    save(tmp_path / "old", student()[1], "depth", {})
    for name in ("_success", "save"):  # need numbers
        monkeypatch.setattr(tuning, name, lambda *_: 0.0)
    settings = FinetuneSettings(demos=4, known_steps=40)
    args = (tmp_path / "old", tmp_path / "new", world, world, lambda env: Pointing(), settings, 0)
    finetune(*args, device="meta", say=lambda line: None)
    assert [ring.device for ring in rings] == [META, META]


def test_a_device_that_is_not_there_is_refused_in_a_line(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert device_of("auto") == device_of("cpu") == "cpu"
    with pytest.raises(UserError, match="no CUDA device"):
        device_of("cuda")


@cuda
def test_distilling_reinforcing_and_fine_tuning_run_on_a_gpu(tmp_path):
    sac, rounds = SacSettings(batch=32, hidden=(16,), replay=600), {"steps": 80, "updates": 5}
    run = {"recipe": "distill+sac", "device": "cuda", "steps": 160, "every": 80, "episodes": 8, "envs": 8}
    c = TrainConfig("peg-depth", **run, sac=sac, distill=rounds)
    best = distilled(c, tmp_path / "run", world, False, Pointing())
    settings = FinetuneSettings(demos=4, updates=5, known_steps=40, episodes=8)
    args = (best, tmp_path / "tuned", world, world, lambda env: Pointing(), settings, 0)
    finetune(*args, device="cuda", say=lambda line: None)
    assert load(tmp_path / "tuned").meta["finetuned"]["after"] >= 0
