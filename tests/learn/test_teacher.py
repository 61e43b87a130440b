"""A teacher is shown exactly what a state policy would see; fine-tuning moves what it says it moves."""

import inspect
import json

import numpy as np
import pytest
import torch
from toy import STEP, Pointing, Reach

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.interface.terms import LIMIT
from vispeg.learn.layout import Layout
from vispeg.learn.methods.clone import CloneSettings, clone
from vispeg.learn.methods.distill import collect
from vispeg.learn.methods.finetune import FinetuneSettings, finetune
from vispeg.learn.modalities import modality
from vispeg.learn.networks.actor import Actor
from vispeg.learn.policy import NetPolicy, load, save
from vispeg.learn.sb3_env import Sb3Env
from vispeg.learn.teacher import StateTeacher, Tare, knowing, teacher_of
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.terms import TERMS
from vispeg.task.terms import Observation


def played(mode, world, steps, seeds=(4, 5)):
    """Observations of the same episodes in an observation mode, the first at rest, under the same actions."""
    from vispeg.task.peg.task import PegInHoleVec

    env = PegInHoleVec(len(seeds), world, mode, autoreset_mode="Disabled", privileged=True)
    rng, obs = stream(0, "actions"), [env.reset(seed=list(seeds))[0]]
    for _ in range(steps):
        action = rng.uniform(-1, 1, (len(seeds), 3)) - [0, 0, 0.6]
        obs.append(env.step(action)[0])
    return obs, env.config


def test_teachers_view_of_a_blind_students_episode_is_the_state_policys_own():
    """The same episodes in `state` and `proprio`, the hole anywhere within 30 mm."""
    (state, config), (blind, _) = played("state", "unknown_hole", 3), played("proprio", "unknown_hole", 3)
    assert np.abs(state[0]["policy"] - blind[0]["policy"]).max() > 0.1
    observed = observed_in(config)
    for a, b in zip(state, blind, strict=True):
        assert np.allclose(knowing(b, observed)["policy"], a["policy"], atol=1e-5)
        assert np.allclose(knowing(a, observed)["policy"], a["policy"], atol=1e-5), "who knows the goal is told nothing"


def test_a_goal_farther_away_than_the_error_of_belief_can_tell_is_shown_where_it_is():
    from vispeg.core.effect import EffectInstance
    from vispeg.worlds.world import World

    far = World(effects=(EffectInstance.of("hole_offset", "fixture", x=0.08, y=-0.02),))
    (state, config), (blind, _) = played("state", far, 1), played("proprio", far, 1)
    observed = observed_in(config)
    for a, b in zip(state, blind, strict=True):
        assert np.abs(b["privileged"][:, observed["mistake"]]).max() == LIMIT
        assert np.allclose(knowing(b, observed)["policy"], a["policy"], atol=1e-5)


def test_the_expert_inserts_as_the_teacher_of_a_student_who_knows_the_goal():
    from vispeg.task.peg.task import PegInHoleVec

    env = PegInHoleVec(2, "unknown_hole", "state", autoreset_mode="Disabled", privileged=True)
    obs, teacher, won = env.reset(seed=[3, 4])[0], teacher_of("expert", env.config), np.zeros(2, bool)
    teacher.reset(2)
    for _ in range(env.config.steps):
        obs, _, over, _, info = env.step(teacher.act(obs))
        won |= [bool(r and r["success"]) for r in info.get("record", (None, None))]
        if over.all():
            break
    assert won.all()


class Watching:
    """A policy that keeps what it is shown."""

    def __init__(self):
        self.views = []

    def reset(self, n, rows=None): ...

    def act(self, obs):
        self.views.append(obs["policy"].astype(float))
        return np.zeros((len(obs["policy"]), 3))


def observed_in(config):
    return Observation(TERMS, config)


def views(obs, observed):
    """What a teacher's policy is shown of observations, (steps, n, depth, size)."""
    teacher, size = StateTeacher(Watching(), observed), observed.policy_size
    teacher.reset(len(obs[0]["policy"]))
    for one in obs:
        teacher.act(one)
    return np.stack(teacher.policy.views).reshape(len(obs), len(obs[0]["policy"]), -1, size)


def test_a_wrong_zero_of_the_wrists_sensor_is_not_shown_to_a_teacher():
    """Any constant of each episode's readings cancels; nothing else than the wrench changes."""
    from vispeg.core.effect import EffectInstance
    from vispeg.worlds.world import World

    bias = EffectInstance.of("wrench_bias", "flange", fx=2.0, fy=-1.0, fz=1.5, tx=0.1, ty=-0.05, tz=0.08)
    (plain, config), (off, _) = played("proprio", World(), 24), played("proprio", World(effects=(bias,)), 24)
    observed = observed_in(config)
    size, wrench = observed.policy_size, slice(observed["force"].start, observed["torque"].stop)
    assert max(np.abs(one["privileged"][:, observed["contact"]]).max() for one in plain) > 0.1, "it touched"
    assert np.abs(off[-1]["policy"] - plain[-1]["policy"]).max() > 0.04
    # The sensor turns with the flange, by less than 0.05 rad: of a bias of 2.7 N or 0.14 N m no more is left.
    assert np.allclose(views(off, observed), views(plain, observed), atol=0.05 * max(2.7 / 20.0, 0.14 / 2.0))
    raw = np.stack([knowing(one, observed)["policy"] for one in off]).reshape(views(off, observed).shape)
    others = np.delete(np.arange(size), np.arange(size)[wrench])
    assert np.array_equal(views(off, observed)[..., others], raw[..., others])


def test_a_tared_reading_is_the_reading_less_the_mean_of_those_without_contact_so_far():
    rng, tare, steps = stream(3, "readings"), Tare(observed_in(PegConfig())), 9
    reading, touch = rng.standard_normal((steps, 2, 15)), np.zeros((steps, 2, 3))
    touch[4:, 0], touch[:, 1], reading[0, :, 6:12] = 1.0, [0, 0, 0.1], 0.0
    touch[0] = 0.0  # episodes begin in the air
    tare.begin(2)
    for k in range(steps):
        stack = np.stack([reading[k], reading[max(k - 1, 0)]], axis=1)
        tared = tare(stack, touch[k])
        zero = reading[1 : min(k, 3) + 1, 0, 6:12].mean(axis=0) if k else np.zeros(6)
        expected = stack.copy()
        expected[0, 0, 6:12] -= zero
        expected[0, 1, 6:12] -= zero if k > 1 else 0.0  # what an episode begins with is no reading
        np.testing.assert_allclose(tared, expected)
    tare.begin(2, np.array([True, False]))
    stack = rng.standard_normal((2, 2, 15))
    np.testing.assert_array_equal(tare(stack, np.zeros((2, 3)))[0], stack[0])


def test_a_teacher_that_knows_is_shown_the_ground_truth_that_it_was_trained_on(tmp_path):
    """The same episodes for a policy that believes the true hole and for a student that does not know it."""
    from vispeg.task.peg.task import PegInHoleVec

    told, blind = (
        PegInHoleVec(2, "unknown_hole", mode, autoreset_mode="Disabled", privileged=True)
        for mode in ("state", "proprio")
    )
    seen = modality("privileged")
    layout = Layout.of(told.single_observation_space, told.single_action_space, (), told.observed.for_teachers)
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

    def target(rows, given):
        return Backwards(rows, "depth")

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
    adam.register_step_pre_hook(lambda *_: rates.append(adam.param_groups[0]["lr"]))
    for _ in range(2):
        clone(actor, [(ring, 1.0)], 6, settings, stream(0, "y"), optimizer=adam)
    expected = settings.lr * (1 + np.cos(np.pi * np.arange(6) / 6)) / 2  # of each update
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

    save(tmp_path / "p", trained_pair()[0], "depth", {})
    with pytest.raises(UserError, match="knows the state"):
        teacher_of(tmp_path / "p", PegConfig())
    seen = modality("state")
    save(tmp_path / "s", Actor(Layout(7, {}, 3), seen, (8,)), "state", {})
    with pytest.raises(UserError, match="another stack"):
        teacher_of(tmp_path / "s", PegConfig())


def test_a_teacher_acts_in_its_students_steps():
    assert teacher_of("state-0.5mm", PegConfig(turn=0.02))  # which nobody turns
    for other in ({"offset": 0.02}, {"policy_period": 0.08}, {"dof": ("x", "z", "y")}):
        with pytest.raises(UserError, match=f"{next(iter(other))}: the teacher was made for other actions"):
            teacher_of("state-0.5mm", PegConfig(**other))


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

    def target(rows, given):
        return Reach(rows, "depth")

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


def test_the_commands_defaults_are_the_settings():
    """Those of the command once were a seventh of what its help and the settings said."""
    from vispeg.api.learning.finetune import finetune

    names = ("demos", "updates", "lr", "known", "episodes")  # tests/cli/test_declarations.py: the command's are these
    stated = inspect.signature(finetune).parameters
    assert FinetuneSettings(**{name: stated[name].default for name in names}) == FinetuneSettings()
