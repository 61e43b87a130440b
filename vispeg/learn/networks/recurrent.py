"""Batches and latents for training actors with and without memory.

A recurrent actor is trained on whole episodes from their start, so that its hidden state in training equals that in
use. Stored hidden states would become stale and need a burn-in (Kapturowski et al. 2019, "R2D2").
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from vispeg.learn.experience.replay import Batch, Images, Replay
from vispeg.learn.networks.actor import Actor

PER_EPISODE = 32  # number of transitions in a batch that one episode replaces


def draw(
    ring: Replay, n: int, horizon: int, recurrent: bool, rng: np.random.Generator, images: Images = "both"
) -> Batch:
    """Draw a batch: n transitions, or for a recurrent actor n / 32 whole episodes (at least 2) of up to `horizon`
    steps.

    `images` selects which observations of single transitions include images; episodes include all.
    """
    if not recurrent:
        return ring.sample(n, rng, images)
    return ring.sequences(max(n // PER_EPISODE, 2), horizon, rng)


def latents(actor: Actor, batch: Batch, after: bool = False, shift: int = 0) -> Tensor:
    """Return the actor's latent (..., hidden) at the start of each transition, or at its end with `after`.

    Args:
        actor: the actor; if recurrent, the batch must hold sequences (time, n, ...) from the start of episodes.
        batch: transitions.
        after: use the observation after the transition.
        shift: largest random shift of images, px.
    """
    if not actor.recurrent:
        return actor.latent(actor.features(batch.next_obs if after else batch.obs, shift))[0]
    steps, n = batch.reward.shape
    # An episode is obs[0], next_obs[0], next_obs[1], ...: the memory runs over all of them once.
    sequence = {key: torch.cat([batch.obs[key][:1], batch.next_obs[key]]) for key in actor.layout.keys}
    flat = actor.features({key: value.flatten(0, 1) for key, value in sequence.items()}, shift)
    latent, _ = actor.latent(flat.unflatten(0, (steps + 1, n)))
    return latent[1:] if after else latent[:-1]
