"""The actor's latents along a batch, for actors with a memory and without.

A recurrent actor learns from whole episodes from their beginning, so that its memory holds in training what it holds
in use and no stored state can be stale (the alternative that Kapturowski et al. 2019, "R2D2", needs burn-in for).
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from vispeg.learn.experience.replay import Batch, Images, Replay
from vispeg.learn.networks.actor import Actor

PER_EPISODE = 32  # transitions of a batch that one episode stands for


def draw(
    ring: Replay, n: int, horizon: int, recurrent: bool, rng: np.random.Generator, images: Images = "both"
) -> Batch:
    """Give a batch worth n transitions: n of them, or n / 32 whole episodes (at least 2) of up to `horizon` steps.

    `images` says where single transitions need theirs; episodes need all.
    """
    if not recurrent:
        return ring.sample(n, rng, images)
    return ring.sequences(max(n // PER_EPISODE, 2), horizon, rng)


def latents(actor: Actor, batch: Batch, after: bool = False, shift: int = 0) -> Tensor:
    """Give the actor's latent (..., hidden) at each transition's start, or at its end where `after`.

    Args:
        actor: with a memory, the batch must hold sequences (time, n, ...) that start with an episode.
        batch: transitions.
        after: whether the observation after the transition is looked at.
        shift: random shift of images, in pixels.
    """
    if not actor.recurrent:
        return actor.latent(actor.features(batch.next_obs if after else batch.obs, shift))[0]
    steps, n = batch.reward.shape
    # An episode is obs[0], next_obs[0], next_obs[1], ...: the memory runs over all of them once.
    sequence = {key: torch.cat([batch.obs[key][:1], batch.next_obs[key]]) for key in actor.layout.keys}
    flat = actor.features({key: value.flatten(0, 1) for key, value in sequence.items()}, shift)
    latent, _ = actor.latent(flat.unflatten(0, (steps + 1, n)))
    return latent[1:] if after else latent[:-1]
