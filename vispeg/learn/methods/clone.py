"""Imitation: regress an actor's mean action, and its estimate of the tip in the goal's frame, on stored data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from vispeg.core.errors import UserError
from vispeg.interface.terms import PRIVILEGED
from vispeg.learn.experience.replay import Replay, mixed
from vispeg.learn.layout import ESTIMATE
from vispeg.learn.networks.actor import Actor
from vispeg.learn.networks.nets import huber
from vispeg.learn.networks.recurrent import draw, latents


@dataclass(frozen=True)
class CloneSettings:
    """Settings of imitation.

    Attributes:
        lr: initial learning rate (Adam); in each `clone` it falls to zero along half a cosine, so that the weights
            have settled before an evaluation.
        batch: transitions per update.
        shift: largest random shift of images, in pixels.
        offset: weight of the loss of the estimate of the tip in the goal's frame; that of the action has weight 1.
        horizon: largest number of steps of an episode that a recurrent actor learns from.
        encoders: learning rate of the image encoders, as a share of `lr`.
    """

    lr: float = 2e-3
    batch: int = 128
    shift: int = 1
    offset: float = 1.0
    horizon: int = 50
    encoders: float = 1.0


def optimizer_of(actor: Actor, settings: CloneSettings) -> torch.optim.Optimizer:
    """Return Adam for an actor; image encoders with another learning rate get their own parameter group."""
    if settings.encoders == 1.0 or not len(actor.encoders):
        return torch.optim.Adam(actor.parameters(), settings.lr, fused=True)
    encoders = [*actor.encoders.parameters()]
    ids = {id(p) for p in encoders}
    head = {"params": [p for p in actor.parameters() if id(p) not in ids], "share": 1.0}
    return torch.optim.Adam([head, {"params": encoders, "share": settings.encoders}], settings.lr, fused=True)


def clone(
    actor: Actor,
    rings: Sequence[tuple[Replay, float]],
    updates: int,
    settings: CloneSettings,
    rng: np.random.Generator,
    *,
    optimizer: torch.optim.Optimizer | None = None,
    frozen: int = 0,
) -> float:
    """Train `actor` to imitate the stored actions.

    The loss is a Huber loss on actions, plus one on the estimate of the tip in the goal's frame where the actor makes
    one and the data hold the truth.

    Args:
        actor: the student.
        rings: replays of (observation, action to imitate), each with its share of each batch; shares are normalised.
        updates: number of gradient steps.
        settings: learning rates, batch size and weights.
        rng: generator of the draws.
        optimizer: an optimizer to continue with, with its moments; None for a new one.
        frozen: number of first updates that leave the image encoders unchanged.

    Returns:
        Mean loss of the last tenth of the updates.

    Raises:
        UserError: shares that are not positive, or a replay without transitions.
    """
    if not rings or min(share for _, share in rings) <= 0:
        raise UserError("imitation needs stores with positive shares", got=[share for _, share in rings])
    total = sum(share for _, share in rings)
    adam = optimizer or optimizer_of(actor, settings)
    for group in adam.param_groups:
        group["lr"] = settings.lr * group.get("share", 1.0)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, updates)
    losses = []
    for update in range(updates):
        actor.encoders.requires_grad_(update >= frozen)
        loss = _loss(actor, rings, total, settings, rng)
        adam.zero_grad(set_to_none=True)
        loss.backward()
        adam.step()
        schedule.step()
        losses.append(float(loss.detach()))
    actor.encoders.requires_grad_(True)
    return float(np.mean(losses[-max(updates // 10, 1) :]))


def _loss(
    actor: Actor, rings: Sequence[tuple[Replay, float]], total: float, s: CloneSettings, rng: np.random.Generator
) -> torch.Tensor:
    """Return the loss on a batch drawn from all rings by their shares, which add up to `total`."""
    batch = None
    for ring, share in rings:
        size = max(round(s.batch * share / total), 1)
        part = draw(ring, size, s.horizon, bool(actor.recurrent), rng, "before")
        batch = part if batch is None else mixed(batch, part)
    if batch is None:
        raise UserError("nothing to imitate")
    latent, valid = latents(actor, batch, shift=s.shift), batch.weight > 0
    loss = huber(torch.tanh(actor.mean(latent))[valid], batch.action[valid])
    if actor.offset is not None and PRIVILEGED in batch.obs:
        loss = loss + s.offset * huber(actor.offset(latent)[valid], batch.obs[PRIVILEGED][..., ESTIMATE][valid])
    return loss
