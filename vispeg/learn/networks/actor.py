"""The actor: image encoders and a perceptron or LSTM, ending in a squashed Gaussian over actions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from vispeg.interface.terms import PRIVILEGED
from vispeg.learn.layout import VECTOR, Layout
from vispeg.learn.modalities import Modality
from vispeg.learn.networks.nets import Scale, mlp, random_shift

LOG_STD = (-10.0, 2.0)  # bounds of the logarithm of the standard deviation
State = tuple[Tensor, Tensor]  # an LSTM's hidden and cell state, (1, n, width) each


class Actor(nn.Module):
    """The policy pi(a | o): a = tanh(u), u ~ N(mean(o), std(o)).

    An actor with images also estimates the tip's position in the goal's frame, in units of OFFSET_M (`offset`).

    Args:
        layout: shapes of the observation and action.
        modality: makes the encoder of each image.
        hidden: widths of the perceptron.
        recurrent: width of an LSTM before the perceptron; 0 for none.
    """

    def __init__(self, layout: Layout, modality: Modality, hidden: Sequence[int] = (256, 256), recurrent: int = 0):
        super().__init__()
        self.layout, self.hidden, self.recurrent = layout, tuple(hidden), recurrent
        self.truth = list(layout.reads)  # indices of the ground truth that it reads
        vector_size = layout.vector + len(self.truth)
        self.scale = Scale(vector_size)
        self.encoders = nn.ModuleDict({key: modality.encoder(key, shape) for key, shape in layout.images.items()})
        encoders: list[Any] = list(self.encoders.values())
        inputs = vector_size + sum(encoder.features for encoder in encoders)
        self.memory = nn.LSTM(inputs, recurrent) if recurrent else None
        self.body = mlp(recurrent or inputs, hidden)
        self.mean = nn.Linear(hidden[-1], layout.action)
        self.log_std = nn.Linear(hidden[-1], layout.action)
        self.offset = nn.Linear(hidden[-1], 3) if layout.images else None

    @property
    def device(self) -> torch.device:
        """The device of the weights; inputs must be on it."""
        return self.mean.weight.device

    def vector(self, obs: Mapping[str, Tensor]) -> Tensor:
        """Return the unscaled vector input (..., n): `policy`, then the entries of the ground truth that it reads."""
        vector = obs[VECTOR]
        return torch.cat([vector, obs[PRIVILEGED][..., self.truth]], dim=-1) if self.truth else vector

    def features(self, obs: Mapping[str, Tensor], shift: int = 0) -> Tensor:
        """Return the scaled vector and the image features, (n, inputs); images are shifted by up to `shift` px."""
        parts = [self.scale(self.vector(obs))]
        parts += [encoder(random_shift(obs[key], shift)) for key, encoder in self.encoders.items()]
        return torch.cat(parts, dim=-1) if len(parts) > 1 else parts[0]

    def latent(self, features: Tensor, state: State | None = None) -> tuple[Tensor, State | None]:
        """Return the latent (n, hidden) of features (n, inputs), and the memory's state after it.

        With an LSTM, features may also be a sequence (time, n, inputs); the latent then is (time, n, hidden).
        """
        if self.memory is None:
            return self.body(features), None
        steps = features if features.ndim == 3 else features[None]
        out, state = self.memory(steps, state)
        return self.body(out if features.ndim == 3 else out[0]), state

    def act(
        self, obs: Mapping[str, Tensor], state: State | None = None, deterministic: bool = True
    ) -> tuple[Tensor, State | None]:
        """Return actions (n, action) within +-1, and the memory's state to pass in at the next step."""
        latent, state = self.latent(self.features(obs), state)
        mean = self.mean(latent)
        if deterministic:
            return torch.tanh(mean), state
        std = self.log_std(latent).clamp(*LOG_STD).exp()
        return torch.tanh(mean + std * torch.randn_like(mean)), state

    def sample(self, latent: Tensor) -> tuple[Tensor, Tensor]:
        """Draw actions (..., action) through which gradients flow; return them with their log density (...).

        log pi(a) = sum_i [log N(u_i) - log(1 - tanh(u_i)^2)], the last term as 2 (log 2 - u - softplus(-2 u)), which
        stays finite (Haarnoja et al. 2018, arXiv:1812.05905, appendix C).
        """
        mean, log_std = self.mean(latent), self.log_std(latent).clamp(*LOG_STD)
        noise = torch.randn_like(mean)
        u = mean + log_std.exp() * noise
        gauss = -0.5 * noise.square() - log_std - 0.5 * math.log(2 * math.pi)
        squash = 2 * (math.log(2) - u - F.softplus(-2 * u))
        return torch.tanh(u), (gauss - squash).sum(-1)

    def initial(self, n: int) -> State | None:
        """Return the memory's state before the first step of n episodes; None without a memory."""
        if not self.recurrent:
            return None
        zero = torch.zeros(1, n, self.recurrent, device=self.device)
        return zero, zero.clone()
