"""Learning learns, by the equations that it states, and sees only what it may."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch
from toy import Reach

from vispeg.learn.evaluation import run_episodes, success_rate
from vispeg.learn.methods.sac import AsymmetricSAC
from vispeg.learn.modalities import Modality, blind, modality
from vispeg.learn.networks.recurrent import latents
from vispeg.learn.policy import NetPolicy
from vispeg.learn.sb3_env import Sb3Env
from vispeg.learn.settings import SacSettings

SMALL = dict(batch=64, hidden=(64, 64), warmup=160, replay=4000, horizon=12, shift=0)


def learner(mode="state", **changes):
    torch.set_num_threads(1)
    settings = SacSettings(**(SMALL | changes))
    model = AsymmetricSAC(Sb3Env(Reach(8, mode)), modality(mode), settings, seed=0)
    model.restart(0)
    return model


def success(model, mode):
    policy = NetPolicy(model.actor, mode)
    return success_rate(run_episodes(policy, Reach(32, mode), range(5000, 5032)))


@pytest.mark.parametrize(
    ("mode", "changes", "steps"),
    [
        ("state", {}, 480),
        ("depth", {}, 480),
        pytest.param("state", {"recurrent": 16}, 480, marks=pytest.mark.slow),
        pytest.param("depth", {"symmetric": True}, 640, marks=pytest.mark.slow),
    ],
)
def test_learns_to_reach(mode, changes, steps):
    model = learner(mode, utd=1.0, lr=1e-3, **changes)
    assert success(model, mode) < 0.5
    model.learn(steps, log_interval=None)
    assert success(model, mode) > 0.9


def test_a_teacher_learns_from_ground_truth_what_it_could_not_from_the_rest():
    """Without images the toy's vector holds the time alone."""
    settings = SacSettings(**SMALL, utd=1.0, lr=1e-3)
    knows = Modality("knows", "state", (), blind, "", knows=True)
    model = AsymmetricSAC(Sb3Env(Reach(8, "depth")), knows, settings, seed=0)
    model.restart(0)
    model.learn(480, log_interval=None)
    played = run_episodes(NetPolicy(model.actor, "knows"), Reach(32, "depth"), range(5000, 5032))
    assert success_rate(played) > 0.9


def test_critic_step_is_the_stated_equation():
    """The loss that `_update_critic` reports against NumPy on the same draws."""
    model = learner()
    model.learn(160, log_interval=None)
    model.measure()
    batch = model.replay.sample(64)
    state = torch.get_rng_state()
    with torch.no_grad():
        action, log_prob = model.actor.sample(latents(model.actor, batch, after=True))
        target_q = model.critic_target(batch.next_obs, action).numpy().min(1)
        q = model.critic(batch.obs, batch.action).numpy()
    alpha = float(model._temperature())
    target = batch.reward.numpy() + (1 - batch.done.numpy()) * 0.97 * (target_q - alpha * log_prob.numpy())
    expected = 0.5 * ((q - target[:, None]) ** 2).sum(1).mean()
    torch.set_rng_state(state)
    assert float(model._update_critic(batch)) == pytest.approx(expected, rel=1e-4)


def test_updates_move_only_what_they_are_for():
    model = learner("depth", warmup=160)
    model.learn(160, log_interval=None)
    model.measure()
    batch = model.replay.sample(32)

    def copy(net):
        return [p.detach().clone() for p in net.parameters()]

    def same(net, before):
        return all(torch.equal(a, b) for a, b in zip(net.parameters(), before, strict=True))

    actor, critic, target = copy(model.actor), copy(model.critic), copy(model.critic_target)
    model._update_critic(batch)
    assert same(model.actor, actor) and same(model.critic_target, target) and not same(model.critic, critic)
    critic = copy(model.critic)
    model._update_actor(batch, 0)
    assert same(model.critic, critic) and not same(model.actor, actor)
    assert all(p.requires_grad for p in model.critic.parameters())


def test_critics_take_no_pixels_and_actors_no_ground_truth():
    model = learner("depth")
    assert set(model.critic.keys) == {"privileged", "policy"}
    assert set(model.actor.layout.keys) == {"policy", "depth_wrist"}
    obs, _ = Reach(4, "depth").reset(seed=1)
    policy = NetPolicy(model.actor, "depth")
    policy.reset(4)
    lied = obs | {"privileged": obs["privileged"] + 1}
    assert np.array_equal(policy.act(obs), policy.act(lied))


@pytest.mark.parametrize("recurrent", [0, 8])
def test_symmetric_critics_take_pixels_through_encoders_of_their_own_and_no_ground_truth(recurrent):
    model = learner("depth", symmetric=True, recurrent=recurrent, shift=1)
    assert set(model.critic.keys) == {"policy"} and set(model.critic.encoders) == {"depth_wrist"}
    model.learn(320, log_interval=None)
    batch, _ = model._sample("both")
    q = model.critic(batch.obs, batch.action)
    assert q.shape == (*batch.reward.shape, 2)
    lied = {**batch.obs, "privileged": batch.obs["privileged"] + 1}
    assert torch.equal(model.critic(lied, batch.action), q)
    blank = {**batch.obs, "depth_wrist": torch.zeros_like(batch.obs["depth_wrist"])}
    assert not torch.allclose(model.critic(blank, batch.action), q)
    own = {id(p) for p in model.critic.encoders.parameters()}
    assert own and not own & {id(p) for p in model.actor.parameters()}


def test_a_recurrent_actor_learns_nothing_from_steps_past_an_episodes_end():
    """Other actions and another truth in those steps, which belong to other episodes, leave the loss as it is."""
    model = learner("depth", recurrent=8)
    model.learn(320, log_interval=None)
    model.measure()
    batch = model.replay.sequences(8, 20)
    beyond = (batch.weight == 0)[..., None]
    assert beyond.any()
    truth = batch.obs["privileged"] + beyond
    other = replace(
        batch, action=-batch.action * beyond + batch.action * ~beyond, obs=batch.obs | {"privileged": truth}
    )
    state, model.ent_coef_optimizer = deepcopy(model.actor.state_dict()), None  # the temperature stays
    losses = []
    for steps in (batch, other):
        model.actor.load_state_dict(state)
        torch.manual_seed(0)
        losses.append(float(model._update_actor(steps, 4)["actor_loss"]))
    assert losses[0] == pytest.approx(losses[1], abs=1e-6)


@pytest.mark.parametrize("shown", [False, True])
def test_more_environments_than_steps_of_warm_up_learn_as_soon_as_there_is_something(shown):
    """After the first step nothing can be drawn yet; its updates are owed. Demonstrations of no share help nothing."""
    model = learner(warmup=4, demo_fraction=0.0, utd=0.25)
    if shown:
        other = learner()
        other.learn(160, log_interval=None)
        model.demos = other.replay
    model.learn(400, log_interval=None)
    assert model._n_updates == pytest.approx(0.25 * 400, abs=2)


def test_updates_per_step_are_what_was_asked():
    model = learner(utd=0.25)
    model.learn(160, log_interval=None)
    before, steps = model._n_updates, model.num_timesteps
    model.learn(400, log_interval=None, reset_num_timesteps=False)
    assert model._n_updates - before == pytest.approx(0.25 * (model.num_timesteps - steps), abs=2)


def test_episodes_are_those_of_their_seeds_whatever_plays_beside_them():
    """The same seed gives the same outcome alone and among others, and none is left out."""
    model = learner()
    policy, seeds = NetPolicy(model.actor, "state"), list(range(100, 123))
    together = run_episodes(policy, Reach(8), seeds)
    alone = run_episodes(policy, Reach(1), seeds)
    assert [o.seed for o in together] == seeds
    assert [(o.success, o.steps) for o in together] == [(o.success, o.steps) for o in alone]
    assert np.allclose([o.reward for o in together], [o.reward for o in alone], atol=1e-5)


def test_rows_that_end_keep_their_last_observation():
    env = Sb3Env(Reach(8))
    env.seed(3)
    env.reset()
    for _ in range(12):
        obs, _, done, infos = env.step(np.zeros((8, 3)))
    assert done.all()
    for row in range(8):
        last = infos[row]["terminal_observation"]
        assert last["policy"][2] == 1 and obs["policy"][row, 2] == 0  # the clock ran out, and began anew
        assert infos[row]["TimeLimit.truncated"]
