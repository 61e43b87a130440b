"""A teacher is shown exactly what a state policy would see; fine-tuning moves what it says it moves."""

import json

import numpy as np
import pytest
import torch
from toy import STEP, Pointing, Reach

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.learn.actor import Actor
from vispeg.learn.clone import CloneSettings, clone
from vispeg.learn.distill import collect
from vispeg.learn.finetune import FinetuneSettings, finetune
from vispeg.learn.layout import Layout
from vispeg.learn.modalities import modality
from vispeg.learn.policy import NetPolicy, load, save
from vispeg.learn.sb3_env import Sb3Env
from vispeg.learn.teacher import knowing, teacher_of


def test_teachers_view_of_a_blind_students_episode_is_the_state_policys_own():
    """The same episodes in `state` and `proprio`, the hole anywhere within 30 mm."""
    from vispeg.task.vector import PegInHoleVec

    modes = "state", "proprio"
    state, blind = (PegInHoleVec(2, "unknown_hole", mode, autoreset_mode="Disabled") for mode in modes)
    a, b = state.reset(seed=[4, 5])[0], blind.reset(seed=[4, 5])[0]
    size = state.config.stack and a["policy"].shape[1] // state.config.stack
    rng = stream(0, "actions")
    assert np.abs(a["policy"] - b["policy"]).max() > 0.1
    for _ in range(3):
        assert np.allclose(knowing(b, size)["policy"], a["policy"], atol=1e-5)
        action = rng.uniform(-1, 1, (2, 3))
        a, b = state.step(action)[0], blind.step(action)[0]


def test_a_teacher_that_knows_is_shown_the_ground_truth_that_it_was_trained_on(tmp_path):
    """The same episodes for a policy that believes the true hole and for a student that does not know it."""
    from vispeg.task.vector import PegInHoleVec

    told, blind = (PegInHoleVec(2, "unknown_hole", mode, autoreset_mode="Disabled") for mode in ("state", "proprio"))
    seen = modality("privileged")
    layout = Layout.of(told.single_observation_space, told.single_action_space, (), bool(seen.truth))
    save(tmp_path, Actor(layout, seen, (16,)), "privileged", {})
    teacher, policy = teacher_of(tmp_path, blind.config), load(tmp_path)
    a, b = told.reset(seed=[4, 5])[0], blind.reset(seed=[4, 5])[0]
    assert np.allclose(teacher.act(b), policy.act(a), atol=1e-4)
    other = dict(b) | {"privileged": b["privileged"] + np.eye(22, dtype=np.float32)[18]}  # friction
    assert not np.allclose(teacher.act(other), teacher.act(b), atol=1e-4)
    with pytest.raises(UserError, match="made for another observation|lacks a part"):
        policy.act({"policy": a["policy"]})


def trained(folder, mode="depth"):
    """A student of the pointing teacher for steps of the toy's own length."""
    torch.manual_seed(0)
    env = Sb3Env(Reach(8, mode))
    actor = Actor(Layout.of(env.observation_space, env.action_space, modality(mode).kinds), modality(mode), (32, 32))
    ring = collect(env, Pointing(), None, 1.0, 320, 0.0, seed=0)
    clone(actor, [(ring, 1.0)], 250, CloneSettings(lr=1e-3, batch=64, shift=0), stream(0, "x"))
    save(folder, actor, mode, {"world": "home"})
    return actor, ring


class Backwards(Reach):
    """A world in which everything is mirrored: actions move the other way."""

    def step(self, actions):
        return super().step(actions * np.array([-1, -1, 1]))


class Mirrored(Pointing):
    def act(self, obs):
        return super().act(obs) * np.array([-1, -1, 1])


def test_finetuning_makes_a_policy_at_home_in_another_world(tmp_path):
    trained(tmp_path / "old")
    settings = FinetuneSettings(demos=20, updates=300, lr=1e-3, known=0.0, batch=64, shift=0, episodes=16)
    target = lambda rows, given: Backwards(rows, "depth")  # noqa: E731
    args = (tmp_path / "old", tmp_path / "new", target, None, lambda env: Mirrored(), settings, 0)
    finetune(*args, say=lambda line: None)
    record = json.loads((tmp_path / "new/finetune.json").read_text())
    assert record["before"] < 0.4 and record["after"] > 0.8
    assert load(tmp_path / "new").meta["parent"] == str(tmp_path / "old")
    with pytest.raises(UserError, match="exists already"):
        finetune(*args, say=lambda line: None)


def test_frozen_encoders_stay_and_the_rest_moves():
    actor, ring = trained_pair()
    encoders = [p.detach().clone() for p in actor.encoders.parameters()]
    body = [p.detach().clone() for p in actor.body.parameters()]
    clone(actor, [(ring, 1.0)], 5, CloneSettings(batch=16), stream(0, "y"), frozen=5)
    assert all(torch.equal(a, b) for a, b in zip(actor.encoders.parameters(), encoders, strict=True))
    assert not all(torch.equal(a, b) for a, b in zip(actor.body.parameters(), body, strict=True))
    clone(actor, [(ring, 1.0)], 5, CloneSettings(batch=16), stream(0, "y"), frozen=0)
    assert not all(torch.equal(a, b) for a, b in zip(actor.encoders.parameters(), encoders, strict=True))


def test_the_learning_rate_falls_along_half_a_cosine_and_begins_anew_with_the_next_imitation():
    actor, ring = trained_pair()
    adam, settings = torch.optim.Adam(actor.parameters(), 1.0, fused=True), CloneSettings(batch=16)
    rates = []
    for _ in range(2):
        watch = lambda update, loss: rates.append(adam.param_groups[0]["lr"])  # noqa: E731
        clone(actor, [(ring, 1.0)], 6, settings, stream(0, "y"), optimizer=adam, watch=watch)
    expected = settings.lr * (1 + np.cos(np.pi * np.arange(1, 7) / 6)) / 2  # as it is left after each update
    assert np.allclose(rates, [*expected, *expected])


def trained_pair():
    env = Sb3Env(Reach(4, "depth"))
    seen = modality("depth")
    actor = Actor(Layout.of(env.observation_space, env.action_space, seen.kinds), seen, (16,))
    return actor, collect(env, Pointing(), None, 1.0, 80, 0.0, seed=0)


def test_the_estimate_of_the_offset_is_learnt_beside_the_action(tmp_path):
    actor, _ = trained(tmp_path / "p")
    policy, env = NetPolicy(actor, "depth"), Reach(32, "depth")
    obs, _ = env.reset(seed=77)
    policy.reset(32)
    action = policy.act(obs)
    truth = obs["privileged"][:, :2]
    assert policy.estimate is not None
    found = policy.estimate[:, :2] / 0.03  # back from metres to the units of `privileged`
    assert np.corrcoef(found[:, 0], truth[:, 0])[0, 1] > 0.9
    assert np.abs(action[:, :2] - np.clip(truth / STEP, -1, 1)).mean() < 0.25


def test_a_teacher_must_know_the_state_and_fit_the_stack(tmp_path):
    from vispeg.task.config import TaskConfig

    save(tmp_path / "p", trained_pair()[0], "depth", {})
    with pytest.raises(UserError, match="knows the state"):
        teacher_of(tmp_path / "p", TaskConfig())
    seen = modality("state")
    save(tmp_path / "s", Actor(Layout(7, {}, 3), seen, (8,)), "state", {})
    with pytest.raises(UserError, match="another stack"):
        teacher_of(tmp_path / "s", TaskConfig())


def test_a_share_that_is_none_is_refused():
    actor, ring = trained_pair()
    with pytest.raises(UserError, match="positive shares"):
        clone(actor, [(ring, 0.0)], 1, CloneSettings(), stream(0, "z"))


RATES = [({"recipe": "distill"}, 2e-3), ({"recipe": "sac"}, 1e-3), ({"lr": 4e-4}, 4e-4)]


@pytest.mark.parametrize(("record", "rate"), RATES)
def test_finetuning_is_at_a_tenth_of_trainings_rate_and_thawed_encoders_at_a_hundredth_of_that(tmp_path, record, rate):
    """Two updates, the encoders frozen in the first; Adam's first step is its rate, whatever the gradient's size."""
    torch.manual_seed(0)
    env, seen = Reach(1, "depth"), modality("depth")
    layout = Layout.of(env.single_observation_space, env.single_action_space, seen.kinds)
    save(tmp_path / "old", Actor(layout, seen, (32,)), "depth", {"world": "home", **record})
    settings = FinetuneSettings(demos=4, updates=2, known=0.0, batch=64, shift=0, episodes=1)
    target = lambda rows, given: Reach(rows, "depth")  # noqa: E731
    args = tmp_path / "old", tmp_path / "new", target, None, lambda env: Pointing(), settings, 0
    finetune(*args, say=lambda line: None)
    before, after = (dict(load(tmp_path / name).actor.named_parameters()) for name in ("old", "new"))

    def moved(part):
        """The furthest that any weight near 0 went, where float32 can tell such steps."""
        steps = [(after[k] - before[k])[before[k].abs() < 0.01] for k in before if k.startswith(part)]
        return max(float(step.abs().max()) for step in steps if len(step))

    lr = json.loads((tmp_path / "new/finetune.json").read_text())["settings"]["lr"]
    assert lr == pytest.approx(0.1 * rate)
    assert moved("encoders.") == pytest.approx(0.01 * 0.5 * lr, rel=0.02)  # half way down the cosine
    assert lr <= 1.001 * moved(("mean.", "body.")) <= 1.6 * lr


def test_the_commands_defaults_are_the_settings(monkeypatch, tmp_path):
    """Those of the command once were a seventh of what its help and the settings said."""
    from vispeg.cli.main import main

    found = []
    monkeypatch.setattr("vispeg.learn.finetune.finetune_in_worlds", lambda *args, **_: found.append(args[5]))
    assert main(["finetune", "depth-S", "--world", "dev", "--out", str(tmp_path / "x")]) == 0
    assert found == [FinetuneSettings()]
