"""Critics: Q functions of the action and of ground truth, or of the action and the actor's observations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from vispeg.learn.networks.nets import Scale, mlp, random_shift


class Critic(nn.Module):
    """Two independent Q(s, a); the smaller of the two limits overestimation (clipped double Q).

    Args:
        sizes: length of each observed vector, by key, in the order in which they are read.
        action: length of the action.
        hidden: widths of each perceptron.
        encoders: image encoders with an attribute `features`, by key, which both Q functions share; none for critics
            without pixels.
    """

    def __init__(
        self,
        sizes: Mapping[str, int],
        action: int,
        hidden: Sequence[int],
        encoders: Mapping[str, nn.Module] | None,
    ):
        super().__init__()
        self.keys = tuple(sizes)
        self.scale = Scale(sum(sizes.values()))
        self.encoders = nn.ModuleDict(encoders or {})
        image_encoders: list[Any] = list(self.encoders.values())
        inputs = sum(sizes.values()) + sum(encoder.features for encoder in image_encoders)
        self.nets = nn.ModuleList(
            nn.Sequential(mlp(inputs + action, hidden), nn.Linear(hidden[-1], 1)) for _ in range(2)
        )

    def inputs(self, obs: Mapping[str, Tensor]) -> Tensor:
        """Return the unscaled input vector (..., inputs)."""
        return torch.cat([obs[key] for key in self.keys], dim=-1)

    def forward(self, obs: Mapping[str, Tensor], action: Tensor, shift: int = 0) -> Tensor:
        """Return the two Q values (..., 2); images are shifted at random by up to `shift` px."""
        parts = [self.scale(self.inputs(obs))]
        for key, encoder in self.encoders.items():
            images = obs[key].flatten(0, -4)  # sequences have leading axes (time, n)
            parts.append(encoder(random_shift(images, shift)).unflatten(0, obs[key].shape[:-3]))
        x = torch.cat([*parts, action], dim=-1)
        return torch.cat([net(x) for net in self.nets], dim=-1)
