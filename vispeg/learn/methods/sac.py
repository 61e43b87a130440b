"""Asymmetric soft actor-critic on Stable-Baselines3's training loop.

The critics read ground truth (`privileged`) and the actor's vector (`policy`), never pixels, so the cost of a critic
update does not depend on the modality (asymmetric actor-critic, Pinto et al. 2017, arXiv:1710.06542). Symmetric
critics, for comparison, read the actor's observations, with image encoders of their own.
"""

# SB3 declares wider types for its networks than those used here.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.sac.policies import SACPolicy
from torch import Tensor, nn

from vispeg.interface.terms import PRIVILEGED
from vispeg.learn.experience.replay import Batch, Images, Replay, mixed
from vispeg.learn.layout import ESTIMATE, VECTOR, Layout
from vispeg.learn.modalities import Modality
from vispeg.learn.networks.actor import Actor, State
from vispeg.learn.networks.critic import Critic
from vispeg.learn.networks.nets import huber, soft_update
from vispeg.learn.networks.recurrent import draw, latents
from vispeg.learn.settings import SacSettings

MEASURED_ON = 4096  # transitions from which the input scales are estimated


class AsymmetricPolicy(SACPolicy):
    """A Stable-Baselines3 policy that holds this package's actor, critics and target critics."""

    def __init__(
        self,
        observation_space: Any,
        action_space: Any,
        lr_schedule: Any,
        *,
        networks: Callable[[], tuple[Actor, Callable[[], Critic]]],
        **_: Any,
    ):
        self._networks = networks  # a function: nn.Module attributes cannot be set before super().__init__
        super().__init__(observation_space, action_space, lr_schedule)

    def _build(self, lr_schedule: Any) -> None:
        lr, device = float(lr_schedule(1)), self.device
        actor, critic = self._networks()
        self.actor: Any = actor.to(device)
        self.critic: Any = critic().to(device)
        self.critic_target: Any = critic().to(device)
        self.critic_target.load_state_dict(self.critic.state_dict())
        self.critic_target.requires_grad_(False)
        self.actor.optimizer = torch.optim.Adam(self.actor.parameters(), lr, fused=True)
        self.critic.optimizer = torch.optim.Adam(self.critic.parameters(), lr, fused=True)

    def set_training_mode(self, mode: bool) -> None:
        """Set the flag only: no layer here behaves differently in training."""
        self.training = mode


class AsymmetricSAC(SAC):
    """SAC whose actor reads the modality's observations and whose critics read ground truth.

    Args:
        env: a Stable-Baselines3 vector environment with Dict observations.
        modality: observations of the actor.
        settings: hyperparameters.
        seed: of networks, exploration and replay.
        device: `cpu`, `cuda` or `auto`.

    Attributes:
        demos: demonstrations, a share `demo_fraction` of each batch; None without.
        measured: whether the input scales are set.
        new: whether the actor is untrained; False keeps its input scale.
    """

    def __init__(
        self,
        env: VecEnv,
        modality: Modality,
        settings: SacSettings,
        *,
        seed: int,
        device: str = "cpu",
    ):
        layout = Layout.of(env.observation_space, env.action_space, modality.kinds, teachers_share(env, modality))
        torch.manual_seed(seed)

        def networks() -> tuple[Actor, Callable[[], Critic]]:
            actor = Actor(layout, modality, settings.hidden, settings.recurrent)
            return actor, lambda: critics(env.observation_space, layout, modality, settings)

        self.settings, self.measured, self.demos, self.new = settings, False, None, True
        self.demos: Replay | None
        self._owed = 0.0  # updates that are due
        self._hidden: State | None = None  # memory of a recurrent actor while it explores
        super().__init__(
            AsymmetricPolicy,
            env,
            settings.lr,
            settings.replay,
            settings.warmup,
            settings.batch,
            settings.tau,
            settings.gamma,
            ent_coef=f"auto_{settings.entropy}",
            replay_buffer_class=Replay,
            replay_buffer_kwargs={"seed": seed},
            policy_kwargs={"networks": networks},
            seed=seed,
            device=device,
        )

    @property
    def replay(self) -> Replay:
        """The replay buffer."""
        assert isinstance(self.replay_buffer, Replay)  # of the class given to SAC
        return self.replay_buffer

    def train(self, gradient_steps: int, batch_size: int = 0) -> None:
        """Run `settings.utd` gradient updates per environment step since the last call."""
        self._owed += self.settings.utd * self.n_envs
        if not len(self.replay) and not self._demos_in_batch:
            return  # nothing to draw yet: a step can be drawn once the next one is there
        if not self.measured:
            self.measure()
        s, values = self.settings, {}
        while self._owed >= 1:
            self._owed -= 1
            self._n_updates += 1
            acts = self._n_updates % s.critic_per_actor == 0 and self._n_updates > s.actor_frozen
            # of images, the critics' targets need those after; the actor's update and symmetric critics those before
            batch, demos = self._sample("both" if acts or s.symmetric else "after")
            values["critic_loss"] = self._update_critic(batch)
            if acts:
                values |= self._update_actor(batch, demos)
            soft_update(self.critic_target, self.critic, s.tau)
        for name, value in values.items():
            self.logger.record(f"train/{name}", float(value))
        self.logger.record("train/updates", self._n_updates)

    def measure(self) -> None:
        """Estimate the input scales of the critics and of a new actor from a sample like the batches to come."""
        batch = (self.replay if self.demos is None else self.demos).sample(MEASURED_ON, images="none")
        if self.demos is not None and self.new and len(self.replay):  # a new actor explores far from the demonstrations
            batch = mixed(batch, self.replay.sample(MEASURED_ON, images="none"))
        if self.new:
            self.actor.scale.measure(self.actor.vector(batch.obs))
        for critic in (self.critic, self.critic_target):
            critic.scale.measure(critic.inputs(batch.obs))
        self.measured = True

    @property
    def _demos_in_batch(self) -> int:
        """Number of demonstrations in a batch."""
        return 0 if self.demos is None else round(self.settings.batch * self.settings.demo_fraction)

    def _sample(self, images: Images) -> tuple[Batch, int]:
        """Draw a batch; also return how many rows at its end are demonstrations."""
        s, rng, demos = self.settings, self.replay.rng, self._demos_in_batch
        if self.demos is None or demos == 0:
            return draw(self.replay, s.batch, s.horizon, bool(s.recurrent), rng, images), 0
        demo_batch = draw(self.demos, demos, s.horizon, bool(s.recurrent), rng, images)
        if not len(self.replay):
            return demo_batch, demo_batch.reward.shape[-1]
        replay_batch = draw(self.replay, s.batch - demos, s.horizon, bool(s.recurrent), rng, images)
        return mixed(replay_batch, demo_batch), demo_batch.reward.shape[-1]

    def _update_critic(self, batch: Batch) -> Tensor:
        """Step on (Q - (r + gamma (1 - done) (min Q'(s', a') - alpha log pi(a'|s'))))^2 / 2 for both critics."""
        shift = self.settings.shift
        with torch.no_grad():
            action, log_prob = self.actor.sample(latents(self.actor, batch, after=True))
            value = self.critic_target(batch.next_obs, action, shift).amin(-1) - self._temperature() * log_prob
            target = batch.reward + (1 - batch.done) * self.gamma * value
        error = self.critic(batch.obs, batch.action, shift) - target[..., None]
        loss = 0.5 * _mean(error.square().sum(-1), batch.weight)
        _step(self.critic, loss)
        return loss.detach()

    def _update_actor(self, batch: Batch, demos: int) -> dict[str, Tensor]:
        """Take one step on alpha log pi(a|s) - min Q(s, a), then one on the temperature towards the target entropy."""
        s = self.settings
        latent, valid = latents(self.actor, batch, False, s.shift), batch.weight > 0
        action, log_prob = self.actor.sample(latent)
        self.critic.requires_grad_(False)
        q = self.critic(batch.obs, action, s.shift).amin(-1)
        self.critic.requires_grad_(True)
        loss = _mean(self._temperature() * log_prob - q, batch.weight)
        if demos:
            progress = min(1.0, (self._n_updates - s.actor_frozen) / s.critic_per_actor / s.clone_updates)
            weight = s.clone_start + progress * (s.clone_end - s.clone_start)
            shown = valid.clone()  # the demonstrations, which are last
            shown[..., :-demos] = False
            loss = loss + weight * huber(torch.tanh(self.actor.mean(latent[shown])), batch.action[shown])
        if self.actor.offset is not None and PRIVILEGED in batch.obs:
            loss = loss + huber(self.actor.offset(latent[valid]), batch.obs[PRIVILEGED][..., ESTIMATE][valid])
        _step(self.actor, loss)
        entropy = _mean(-log_prob.detach(), batch.weight)
        if self.log_ent_coef is not None and self.ent_coef_optimizer is not None:
            self.ent_coef_optimizer.zero_grad()
            (self.log_ent_coef * (entropy - float(self.target_entropy))).sum().backward()
            self.ent_coef_optimizer.step()
        return {"actor_loss": loss.detach(), "entropy": entropy, "temperature": self._temperature()}

    def _temperature(self) -> Tensor:
        assert self.log_ent_coef is not None  # the coefficient is learned
        return self.log_ent_coef.detach().exp().squeeze()

    def _sample_action(
        self, learning_starts: int, action_noise: Any = None, n_envs: int = 1
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the exploring actions (n, action) twice: to execute and to store."""
        if self.num_timesteps < learning_starts:
            size = (n_envs, self.actor.layout.action)
            action = self.replay.rng.uniform(-1, 1, size).astype(np.float32)
        else:
            obs = tensors(self._last_obs, self.actor.layout, self.device)
            if self._hidden is None:
                self._hidden = self.actor.initial(n_envs)
            with torch.no_grad():
                sampled, self._hidden = self.actor.act(obs, self._hidden, deterministic=False)
            action = sampled.cpu().numpy()
        return action, action

    def _store_transition(
        self,
        replay_buffer: Any,
        buffer_action: np.ndarray,
        new_obs: Any,
        reward: np.ndarray,
        dones: np.ndarray,
        infos: Any,
    ) -> None:
        ends = {key: value.copy() for key, value in new_obs.items()} if dones.any() else new_obs
        for row in np.flatnonzero(dones):
            for key, value in infos[row]["terminal_observation"].items():
                ends[key][row] = value  # `new_obs` holds the next episode's first observation
        replay_buffer.add(self._last_obs, ends, buffer_action, reward, dones, infos)
        self._last_obs = new_obs
        if self._hidden is not None and dones.any():
            going = torch.from_numpy(~dones).to(self.device)[None, :, None]
            self._hidden = (self._hidden[0] * going, self._hidden[1] * going)

    def restart(self, seed: int) -> None:
        """Reset every environment with `seed`; episodes in progress end without their last transition.

        Checkpoints are taken here, so that a resumed run depends only on the seed and on the saved state.
        """
        self.replay.cut()
        assert self.env is not None
        self.env.seed(seed)
        self._last_obs, self._hidden = self.env.reset(), None


def teachers_share(env: Any, modality: Modality) -> tuple[int, ...]:
    """Return the ground-truth indices that a policy of this modality reads: those of a task's teacher terms."""
    if not modality.knows:
        return ()
    observed = getattr(getattr(env, "env", env), "observed", None)
    return observed.for_teachers if observed else tuple(range(env.observation_space.spaces[PRIVILEGED].shape[0]))


def critics(space: Any, layout: Layout, modality: Modality, settings: SacSettings) -> Critic:
    """Make new critics that read ground truth and the actor's vector, or, if symmetric, the actor's observations."""
    keys = (VECTOR,) if settings.symmetric else tuple(k for k in (PRIVILEGED, VECTOR) if k in space.spaces)
    images = layout.images if settings.symmetric else {}
    return Critic(
        {key: int(np.prod(space.spaces[key].shape)) for key in keys},
        layout.action,
        settings.hidden,
        {key: modality.encoder(key, shape) for key, shape in images.items()},
    )


def tensors(obs: Mapping[str, np.ndarray], layout: Layout, device: torch.device | str) -> dict[str, Tensor]:
    """Return the observations that the layout names, as tensors."""
    return {key: torch.as_tensor(np.ascontiguousarray(obs[key]), device=device) for key in layout.keys}


def _mean(x: Tensor, weight: Tensor) -> Tensor:
    """Return the mean of x, weighted."""
    return (x * weight).sum() / weight.sum().clamp_min(1)


def _step(net: nn.Module, loss: Tensor) -> None:
    net.optimizer.zero_grad(set_to_none=True)
    loss.backward()
    net.optimizer.step()
