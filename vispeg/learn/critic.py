"""The critics: Q functions of ground truth and action, which need no pixels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from vispeg.learn.nets import Scale, mlp


class Critic(nn.Module):
    """Two independent Q(s, a), so that the smaller of the two bounds the overestimate (clipped double Q).

    Args:
        sizes: length of each observed vector, by key, in the order in which they are read.
        action: length of the action.
        hidden: widths of each perceptron.
    """

    def __init__(self, sizes: Mapping[str, int], action: int, hidden: Sequence[int] = (256, 256)):
        super().__init__()
        self.keys = tuple(sizes)
        inputs = sum(sizes.values())
        self.scale = Scale(inputs)
        self.nets = nn.ModuleList(
            nn.Sequential(mlp(inputs + action, hidden), nn.Linear(hidden[-1], 1)) for _ in range(2)
        )

    def inputs(self, obs: Mapping[str, Tensor]) -> Tensor:
        """(..., inputs) unscaled."""
        return torch.cat([obs[key] for key in self.keys], dim=-1)

    def forward(self, obs: Mapping[str, Tensor], action: Tensor) -> Tensor:
        """Q values (..., 2)."""
        x = torch.cat([self.scale(self.inputs(obs)), action], dim=-1)
        return torch.cat([net(x) for net in self.nets], dim=-1)
